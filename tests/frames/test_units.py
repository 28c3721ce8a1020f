"""Zero, sign and unit of channels that are alike, unlike, or read less when they are pressed, on both roads."""

import numpy as np
import pytest

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.frames.units import measure_units
from tactile_viewgcn.pages.inspection_text import inspection_lines
from tactile_viewgcn.pages.source_inspection import Overview
from tactile_viewgcn.params import load
from tactile_viewgcn.tables.frames import TEST, TRAIN, read_frames, save_table
from tactile_viewgcn.tables.recordings import ArrayRecordings
from tests.glove_data import FILE, OBJECTS, recording

RECORDINGS = 8  # of each of four objects


def glove(turned: bool, label: int, seed: int) -> np.ndarray:
    counts = recording((*OBJECTS, "mug")[label], seed)
    return (1023 - counts if turned else counts).astype(np.int16)


def bend_and_motion(label: int, seed: int) -> np.ndarray:
    """Five sensors in counts, which say nothing, and three in g, which differ between the objects."""
    rng, g = np.random.default_rng([seed, label]), np.random.default_rng(label).normal(0, 0.5, 3)
    bend = 700 + rng.normal(0, 60, (1, 5)) + rng.normal(0, 5, (40, 5))
    return np.concatenate([bend, g + rng.normal(0, 0.06, (1, 3)) + rng.normal(0, 0.02, (40, 3))], axis=1)[:, None]


def shear_and_position(label: int, seed: int) -> np.ndarray:
    """Three channels of negative shear, which differ between the objects, beside three positions, which do not."""
    rng, rise = np.random.default_rng([seed, label]), np.linspace(0, 1, 40)[:, None]
    shear = rng.normal(0, 0.02, (40, 3)) - 0.3 * (label + 1) * rise
    return np.concatenate([shear, 5 + 45 * rise + rng.normal(0, 2, (1, 3))], axis=1)[:, None]


def offsets(label: int, seed: int) -> np.ndarray:
    """Five sensors from 4,700 to 5,600 counts, each with a range of 200."""
    rng, zero = np.random.default_rng([seed, label]), np.array([5000, 5200, 4700, 5600, 5100])
    force = np.clip(np.arange(40) / 10 - 1, 0, 1)[:, None] * rng.uniform(50, 200, 5)
    return np.rint(zero + force + rng.normal(0, 1, (40, 5)))[:, None]


def restless_counts(label: int, seed: int) -> np.ndarray:
    """Whole counts of six gains that never stand still."""
    force = np.abs(np.cumsum(np.random.default_rng([seed, label]).normal(0, 0.5, (40, 6)), axis=0))
    return np.rint(force * [20, 40, 100, 300, 600, 800])[:, None]


def force_and_angle(label: int, seed: int) -> np.ndarray:
    """Three restless forces of up to 6 N, to 0.01 N, beside two slow angles of up to 90 degrees, to one."""
    rng, frame = np.random.default_rng([seed, label]), np.arange(40)[:, None]
    force, angle = 3 + 3 * np.sin(0.3 * frame + rng.uniform(0, 6, 3)), 90 * frame / 40 * rng.uniform(0, 1, 2)
    return np.concatenate([np.round(force, 2), np.round(angle)], axis=1)[:, None]


def newton(label: int, seed: int) -> np.ndarray:
    """Four forces of equal noise, of 1 to 50 N."""
    noise = np.random.default_rng([seed, label]).normal(0, 0.02, (40, 4))
    return (np.clip(np.arange(40) / 8 - 1, 0, 1)[:, None] * [1, 4, 15, 50] + noise)[:, None]


def counts_and_quaternion(label: int, seed: int) -> np.ndarray:
    turned = np.cumsum(np.random.default_rng([seed, label]).normal(0, 0.02, (40, 4)), axis=0)
    return np.concatenate([offsets(label, seed), turned[:, None]], axis=2)


def table(make, seeds=RECORDINGS) -> ArrayRecordings:
    labels = np.repeat(np.arange(4), seeds)
    arrays = [make(label, seed) for label in range(4) for seed in range(seeds)]
    return ArrayRecordings(arrays, ["ball", "cup", "mug", "pen"], labels, np.zeros(len(labels), dtype=int))


def alike(label: int, seed: int) -> np.ndarray:
    return glove(False, label, seed)


def falling(label: int, seed: int) -> np.ndarray:
    return glove(True, label, seed)


@pytest.mark.parametrize(
    ("make", "unit", "signs"),
    [
        (alike, "one", None), (falling, "one", {-1}), (lambda *of: alike(*of)[:1], "one", None),
        (offsets, "one", None), (restless_counts, "one", None), (newton, "one", None),
        (bend_and_motion, "each", {1}), (force_and_angle, "each", {1}), (counts_and_quaternion, "each", {1}),
        (shear_and_position, "each", {-1, 1}),
    ],
    ids=[
        "alike", "falling", "frames alone", "offsets", "gains", "newton",
        "counts and g", "newton and degrees", "counts and quaternion", "negative shear",
    ],
)  # fmt: skip
def test_zero_sign_and_unit_are_those_of_the_channels(make, unit, signs):
    value, channels, text = measure_units(table(make), "auto")
    assert value == unit and text
    assert (channels is None) if signs is None else (set(np.sign(channels[1]).ravel()) == signs)
    if unit == "each":  # every channel rises to 40 % or more, and next to nothing lies below its zero
        readings = table(make).in_units(channels).counts[np.arange(4 * RECORDINGS * 40)]
        assert np.percentile(readings, 99, axis=0).min() > 40 and (readings < 0).mean() < 0.01
        assert measure_units(table(make), "each")[1].tolist() == channels.tolist()
        assert measure_units(table(make), "one")[1] is None
    elif signs:
        np.testing.assert_array_equal(table(make).in_units(channels).counts[np.arange(9)] % 1, 0)


@pytest.mark.parametrize("make", [bend_and_motion, shear_and_position])
def test_unlike_channels_are_recognised_on_both_roads(make, tmp_path):
    asked = load(FILE, ("split.by=recording", "split.folds=4"))
    made = preprocess_recordings(table(make), asked.preprocess, asked.split).frames
    save_table(tmp_path / "frames", made)
    frames = read_frames(tmp_path / "frames")
    np.testing.assert_array_equal(frames.channels, made.channels)
    means = np.stack([frames.inputs(np.flatnonzero(frames.recording == n)).mean(axis=0).ravel() for n in range(32)])
    side, label = (
        np.array([column[frames.recording == n][0] for n in range(32)]) for column in (frames.side, frames.label)
    )
    train, test = means[side == TRAIN], means[side == TEST]
    nearest = np.abs(test[:, None] - train).sum(axis=2).argmin(axis=1)
    assert (label[side == TRAIN][nearest] == label[side == TEST]).mean() > 0.8

    X, new = ([make(label, seed) for label in range(4) for seed in range(first, first + 8)] for first in (0, 8))
    classifier = TactileClassifier(system="svm").fit(X, y := np.repeat(np.arange(4), 8))
    assert classifier.params_.preprocess.unit == "auto"
    assert [note.value for note in classifier.notes_ if note.key == "preprocess.unit"] == ["each"]
    assert classifier.score(new, y) > 0.9
    recogniser = classifier.recogniser_
    sets = np.stack([counts[::5] for counts in new])  # raw, above the model's own baseline
    assert (recogniser.probabilities(sets).argmax(axis=1) == y).mean() > 0.9
    same = recogniser.probabilities(sets, recogniser.baseline("session 0"))
    np.testing.assert_allclose(recogniser.probabilities(sets), same, atol=1e-6)


def test_sensors_that_fall_when_pressed_are_answered_as_those_that_rise():
    y = np.repeat(np.arange(4), 4)
    answers = []
    for turned in (False, True):
        X, new = ([glove(turned, label, 9 * part + n) for label in range(4) for n in range(4)] for part in (0, 1))
        answers.append(TactileClassifier(system="kernel").fit(X, y).predict_proba(new))
    np.testing.assert_allclose(*answers, atol=1e-5)
    assert (answers[0].argmax(axis=1) == y).all()


def test_idle_sensors_are_not_called_faulty_and_real_numbers_are_no_counts():
    rng = np.random.default_rng(0)
    moving = 100 * rng.random((4, 8, 8)) * (np.arange(64).reshape(8, 8) % 4 > 0)

    def make(label: int, seed: int) -> np.ndarray:
        force = 0.6 + 0.4 * np.sin(np.arange(40) + seed)[:, None, None]
        return moving[label] * force + 0.01 * (np.random.default_rng(seed).random((40, 8, 8)) < 0.02)

    overview = Overview(table(make), load(FILE).preprocess)
    assert overview.hand.all_contact and not overview.stuck.any()
    assert "counts" not in "\n".join(inspection_lines(overview))
