"""Every member on extreme readings and lengths of objects that press different sensors."""

from typing import get_args

import numpy as np
import pytest

from benchmarks.stability.rows import max_rel_error
from tactile_viewgcn.params import SensorMember
from tests.members.small_recordings import ARRAY, answers, fitted, values

CHANNELS = np.ones((1, 5), dtype=bool)
SCALED = "a sensor of 1e27 times the readings"
FRAME = "one frame each"
SINGLE = "one recording of each"
NOT_BY_ONE_FRAME = {
    ("convolutions", "channels"),
    ("convolutions", "array"),
    ("svm", "array"),
    ("trees", "array"),
}
CASES = {  # functions of a recording's counts, which are at most 60, and of its index
    "a constant sensor": lambda counts, _: last(counts, 500.1),
    "a sensor that reads 0": lambda counts, _: last(counts, 0),
    SCALED: lambda counts, _: last(counts, 1e27 * counts[:, :1]),
    "a sensor of 1e-30 times the readings": lambda counts, _: last(counts, 1e-30 * counts[:, :1]),
    "1e27 times": lambda counts, _: 1e27 * counts,
    "1e-30 times": lambda counts, _: 1e-30 * counts,
    "0 and the most of 16 bits": lambda counts, _: np.where(counts > 30, 65535, 0),
    "unequal lengths": lambda counts, index: counts[index % 9 : 40 - index % 7],
    SINGLE: lambda counts, _: counts,
    FRAME: lambda counts, index: counts[20 + index % 5][None],
    "all equal": lambda counts, _: 0 * counts + 1,
    "all 0": lambda counts, _: 0 * counts,
}


def last(counts, reading):
    """Return counts (T, S) whose last sensor reads one value, or values (T, 1)."""
    of_last = np.broadcast_to(reading, (len(counts), 1))
    return np.concatenate([counts[:, :-1], of_last], axis=1)


def presses(case, live=CHANNELS, seed=0, repeats=6):
    """Return recordings of three objects, changed as the case says, and their labels.

    Each object presses one sensor for half of the time.
    """
    rng = np.random.default_rng(seed)
    labels = np.tile(np.arange(3), repeats)
    recordings = rng.normal(0, 1, (len(labels), 40, live.sum()))
    recordings[np.arange(len(labels)), 10:30, labels] += 55
    change = CASES[case]
    changed = [change(counts, i).astype(np.float32) for i, counts in enumerate(recordings)]
    return changed, labels


@pytest.mark.stability("members on extreme readings")
@pytest.mark.parametrize(("kind", "live"), [("channels", CHANNELS), ("array", ARRAY)])
@pytest.mark.parametrize("member", get_args(SensorMember))
def test_every_member_distinguishes_objects_by_extreme_readings(row, member, kind, live):
    """There are three exceptions.

    The weights of convolutions add up to 0, so convolutions do not distinguish objects by one
    frame. Nor do svm and trees with an array, because they read its noise too. In an array, a far
    stronger sensor outweighs others.
    """
    for case in CASES:
        if case == SINGLE:
            trained = presses(case, live, repeats=1)
            new, labels = trained
        else:
            trained = presses(case, live)
            new, labels = presses(case, live, seed=1)
        probabilities = answers(fitted([member], *trained, live=live), new)
        where = f"{case}, {kind}, {member}"
        sum_error = max_rel_error(probabilities.sum(axis=1), 1 + 0 * labels)
        row(f"probabilities' sum less 1, {where}", sum_error, 1e-5)
        if case in ("all equal", "all 0"):
            row(f"answers that differ, {where}", np.ptp(probabilities, axis=0).max(), 1e-5)
        elif case != FRAME or (member, kind) not in NOT_BY_ONE_FRAME:
            tolerance = 1 / 9 if (case, kind) == (SCALED, "array") else 0
            wrong = (probabilities.argmax(axis=1) != labels).mean()
            row(f"wrong answers, {where}", wrong, tolerance)


@pytest.mark.stability("members on extreme readings")
# in these cases the scaled readings can be outside of float32
@pytest.mark.parametrize("case", ["unequal lengths", "1e-30 times"])
@pytest.mark.parametrize("member", get_args(SensorMember))
def test_readings_far_outside_of_the_training_set_have_finite_answers_and_1_000_frames_one(
    row, member, case
):
    recordings, labels = presses(case)
    classifier = fitted([member], recordings, labels, live=CHANNELS, sizes=(1000,))
    read = values(classifier, recordings[0])
    logits = classifier.view_sets(read, np.arange(1000)[None] % 40)
    row(f"wrong answers, 1,000 views, {case}, {member}", int(logits.argmax() != 0))
    for reading in (0, 65535, 1e20, -1e30):
        new = [last(counts, np.float32(reading)) for counts in recordings]
        sums = answers(classifier, new).sum(axis=1)
        sum_error = max_rel_error(sums, 1 + 0 * sums)
        row(f"probabilities' sum less 1, a new {reading:g}, {case}, {member}", sum_error, 1e-5)
