"""Every member on extreme readings and lengths of objects that press different sensors."""

from typing import get_args

import numpy as np
import pytest

from benchmarks.stability.rows import max_rel_error
from tactile_viewgcn.params import SensorMember
from tests.members.small_recordings import ARRAY, answers, fitted, values

CHANNELS = np.ones((1, 5), dtype=bool)
SCALED, FRAME, SINGLE = (
    "a sensor of 1e27 times the readings",
    "one frame each",
    "one recording of each",
)
NOT_BY_ONE_FRAME = {
    ("convolutions", "channels"),
    ("convolutions", "array"),
    ("svm", "array"),
    ("trees", "array"),
}
CASES = {  # functions of a recording's counts, which are at most 60, and of its number
    "a constant sensor": lambda counts, _: last(counts, 500.1),
    "a sensor that reads 0": lambda counts, _: last(counts, 0),
    SCALED: lambda counts, _: last(counts, 1e27 * counts[:, :1]),
    "a sensor of 1e-30 times the readings": lambda counts, _: last(counts, 1e-30 * counts[:, :1]),
    "1e27 times": lambda counts, _: 1e27 * counts,
    "1e-30 times": lambda counts, _: 1e-30 * counts,
    "0 and the most of 16 bits": lambda counts, _: np.where(counts > 30, 65535, 0),
    "unequal lengths": lambda counts, number: counts[number % 9 : 40 - number % 7],
    SINGLE: lambda counts, _: counts,
    FRAME: lambda counts, number: counts[20 + number % 5][None],
    "all equal": lambda counts, _: 0 * counts + 1,
    "all 0": lambda counts, _: 0 * counts,
}


def last(counts, reading):
    return np.concatenate([counts[:, :-1], np.broadcast_to(reading, (len(counts), 1))], axis=1)


def presses(case, live=CHANNELS, seed=0, each=6):
    """Return recordings of three objects, changed as the case says, and their labels.

    Each object presses one sensor for half of the time.
    """
    rng, labels = np.random.default_rng(seed), np.tile(np.arange(3), each)
    counts = rng.normal(0, 1, (len(labels), 40, live.sum()))
    counts[np.arange(len(labels)), 10:30, labels] += 55
    return [
        CASES[case](each, number).astype(np.float32) for number, each in enumerate(counts)
    ], labels


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
        examples = presses(case, live, each=1 if case == SINGLE else 6)
        made, labels = examples if case == SINGLE else presses(case, live, seed=1)
        shares = answers(fitted([member], *examples, live=live), made)
        row(
            f"probabilities' sum less 1, {case}, {kind}, {member}",
            max_rel_error(shares.sum(axis=1), 1 + 0 * labels),
            1e-5,
        )
        if case in ("all equal", "all 0"):
            row(
                f"answers that differ, {case}, {kind}, {member}", np.ptp(shares, axis=0).max(), 1e-5
            )
        elif case != FRAME or (member, kind) not in NOT_BY_ONE_FRAME:
            tolerance = 1 / 9 if (case, kind) == (SCALED, "array") else 0
            row(
                f"wrong answers, {case}, {kind}, {member}",
                (shares.argmax(axis=1) != labels).mean(),
                tolerance,
            )


@pytest.mark.stability("members on extreme readings")
# in these cases the scaled readings can be outside of float32
@pytest.mark.parametrize("case", ["unequal lengths", "1e-30 times"])
@pytest.mark.parametrize("member", get_args(SensorMember))
def test_readings_far_outside_of_the_training_have_finite_answers_and_1_000_frames_one(
    row, member, case
):
    classifier = fitted([member], *presses(case), live=CHANNELS, sizes=(1000,))
    logits = classifier.view_sets(
        values(classifier, presses(case)[0][0]), np.arange(1000)[None] % 40
    )
    row(f"wrong answers, 1,000 views, {case}, {member}", int(logits.argmax() != 0))
    for reading in (0, 65535, 1e20, -1e30):
        sums = answers(
            classifier, [last(each, np.float32(reading)) for each in presses(case)[0]]
        ).sum(axis=1)
        row(
            f"probabilities' sum less 1, a new {reading:g}, {case}, {member}",
            max_rel_error(sums, 1 + 0 * sums),
            1e-5,
        )
