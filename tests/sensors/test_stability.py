"""Every candidate of the preset `best` on extreme readings, numbers of classes and of views, in the glove's unit.

Objects that press different sensors have to be distinguished wherever the readings differ.
"""

import numpy as np
import pytest

from benchmarks.stability.rows import max_rel_error
from tactile_viewgcn.sensors.estimators import TrainingFrames
from tactile_viewgcn.sensors.kernels import Kernel
from tactile_viewgcn.sensors.pipelines import MEMBERS
from tactile_viewgcn.sensors.unit import contact_unit
from tests.glove_data import recipe

CANDIDATES = list(dict.fromkeys(name for members in recipe().model.candidates for name in members))
WHOLE = np.ones((3, 3), dtype=bool)  # all sensors live
LABELS = np.repeat(np.arange(3), 24)
COUNTS = np.random.default_rng(0).normal(0, 1, (72, 9))
COUNTS[np.arange(72), LABELS] += 60  # an object presses one sensor
STRENGTH = np.random.default_rng(0).normal(0, 1, (72, 1)) + 60 * LABELS[:, None]
DISTINCT = {  # counts (n, S) above baseline of three objects, and the standard deviation of their noise
    "a constant sensor": (np.concatenate([COUNTS[:, :8], np.full((72, 1), 500.0)], axis=1), 1.0),
    "a sensor that reads 0": (np.concatenate([COUNTS[:, :8], np.zeros((72, 1))], axis=1), 1.0),
    "0 and the most of 16 bits": (np.where(COUNTS > 30, 65535.0, 0.0), np.inf),
    "0.7 and nothing else": (np.where(COUNTS > 30, 0.7, 0.0), np.inf),
    "1e-30 times": (1e-30 * COUNTS, 1e-30),
    "1e27 times": (1e27 * COUNTS, 1e27),
}
BLANK = {"all equal": np.ones((72, 9)), "all 0": np.zeros((72, 9)), "below the baseline": -np.abs(COUNTS)}


def training(counts, labels, *, noise=1.0, live=WHOLE, views=4, pool=12):
    """Frames in units, as the pipeline fits systems to them, of recordings of `pool` frames each."""
    frames = (counts / np.float32(contact_unit(counts, noise))).astype(np.float32)
    return TrainingFrames(
        frames, labels, labels.max() + 1, np.arange(len(labels)) // pool, views, (views,), live, 0, True
    )


def answers(name, data):
    """Logits (P, classes) and labels (P,) of a view set from each pool, or from 50 of them, evenly spaced."""
    system, pools = MEMBERS[name]().fit(data), np.unique(data.pools)
    pools = pools[:: -(-len(pools) // 50)]
    sets = np.stack([np.resize(np.flatnonzero(data.pools == pool), data.views) for pool in pools])
    frames, places = np.unique(sets, return_inverse=True)
    return system.logits(system.frame_values(data.frames[frames])[places]), data.labels[sets[:, 0]]


def wrong(name, data):
    """Share of wrong answers; infinite where a logit is not finite."""
    logits, labels = answers(name, data)
    return float((logits.argmax(axis=1) != labels).mean()) if np.isfinite(logits).all() else np.inf


@pytest.mark.stability("candidates on extreme readings")
@pytest.mark.parametrize("name", CANDIDATES)
def test_every_candidate_distinguishes_objects_by_extreme_readings(row, name):
    for case, (counts, noise) in DISTINCT.items():
        row(f"wrong answers, {case}, {name}", wrong(name, training(counts, LABELS, noise=noise)))


@pytest.mark.stability("candidates on extreme readings")
@pytest.mark.parametrize("name", CANDIDATES)
def test_answers_to_readings_without_differences_are_finite(row, name):
    for case, counts in BLANK.items():
        logits, _ = answers(name, training(counts, LABELS))
        row(f"logits that are not finite, {case}, {name}", int((~np.isfinite(logits)).sum()))
        row(f"answers that differ between equal view sets, {case}, {name}", np.ptp(logits, axis=0).max(), 1e-5)


@pytest.mark.stability("candidates on extreme readings")
@pytest.mark.parametrize("name", CANDIDATES)
def test_every_candidate_answers_by_a_single_live_sensor(row, name):
    """A light, a firm and no touch, of which the angle and the first threshold distinguish only two."""
    one = np.eye(3, dtype=bool) & (np.arange(3) == 1)
    tolerance = {"max_kernel_cosine": 1 / 3, "max_logistic": 1 / 3}.get(name, 0.0)
    row(f"wrong answers, one live sensor, {name}", wrong(name, training(STRENGTH, LABELS, live=one)), tolerance)


@pytest.mark.stability("one class and 1,000")
@pytest.mark.slow
@pytest.mark.parametrize("name", CANDIDATES)
def test_1_000_classes_by_which_of_twenty_sensors_they_press(row, name):
    labels = np.repeat(np.arange(1000), 4)
    bits = labels[:, None] >> np.arange(10) & 1
    counts = np.zeros((4000, 36))
    counts[:, :20] = 60 * np.concatenate([bits, 1 - bits], axis=1)
    counts += np.random.default_rng(0).normal(0, 1, counts.shape)
    data = training(counts, labels, live=np.ones((6, 6), dtype=bool), pool=4)
    row(f"wrong answers, 1,000 classes, {name}", wrong(name, data))


@pytest.mark.stability("a thousand views")
@pytest.mark.parametrize("name", CANDIDATES)
def test_view_sets_of_1_000_frames(row, name):
    row(f"wrong answers, 1,000 views, {name}", wrong(name, training(COUNTS, LABELS, views=1000)))


@pytest.mark.stability("kernels")
def test_a_constant_sensor_does_not_change_the_kernel(row):
    """Whatever it reads: the points are compared about their mean."""
    for constant in (0.0, 65535.0, 1e15):
        points = COUNTS.astype(np.float32), np.concatenate([COUNTS, np.full((72, 1), constant)], axis=1)
        plain, other = (Kernel().centred(each.astype(np.float32), 1e-3).kernel(each) for each in points)
        row(f"kernel with a sensor that always reads {constant:g}", max_rel_error(other, plain), 1e-5)
