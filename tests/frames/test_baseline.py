"""The baseline of each sensor."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames import baseline as module
from tactile_viewgcn.frames.baseline import (
    MAX_PASSES,
    OUTLIER_SD,
    ROUNDING_SD,
    constant_baseline,
    empty_hand_baseline,
    evenly,
    quiet_baseline,
    trimmed_moments,
)
from tactile_viewgcn.readers.stag_metadata import read_metadata
from tests.sources import written
from tests.stag_files import SENSORS

FRAMES = 10_000


def resting(baseline, frames, seed=0):
    """Whole counts of sensors at `baseline` (H, W), Gaussian noise of sd 0.95 on them."""
    noise = np.random.default_rng(seed).normal(0, 0.95, size=(frames, *np.shape(baseline)))
    return np.round(baseline + noise).astype(np.int16)


@pytest.mark.parametrize("fraction", [0.0, 0.3, 0.5, 0.8])
def test_a_known_rest_is_found_to_a_twentieth_of_a_count_below_outliers(fraction):
    baseline = np.full((2, 3), 513 + fraction)
    counts = resting(baseline, FRAMES)
    outlier = np.random.default_rng(1).random(counts.shape) < 0.01
    counts[outlier] += 20
    mean, noise = trimmed_moments(counts)
    assert (mean.shape, mean.dtype, noise.dtype) == ((2, 3), np.float32, np.float32)
    np.testing.assert_allclose(mean, baseline, atol=0.05)
    np.testing.assert_allclose(noise, np.hypot(0.95, ROUNDING_SD), atol=0.05)
    assert (counts.mean(axis=0) - baseline > 0.1).all()  # what the outliers do to a mean that keeps them


def _trimmed_one(values):
    """Mean and standard deviation of one sensor, outliers cut, value by value."""
    kept = values
    for _ in range(MAX_PASSES):
        mean, noise = np.mean(kept), max(np.std(kept), ROUNDING_SD)
        again = [value for value in values if abs(value - mean) <= OUTLIER_SD * noise]
        if again == list(kept):
            break
        kept = again
    return mean, noise


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 40), st.integers(0, 10_000), st.sampled_from([0, 5, 400]))
def test_trimming_all_sensors_at_once_is_trimming_each(frames, seed, excess):
    counts = resting(np.full((2, 2), 514.0), frames, seed)
    counts[0, 0, 0] += excess
    mean, noise = trimmed_moments(counts)
    for at in np.ndindex(2, 2):
        naive = _trimmed_one(counts[:, *at].astype(float).tolist())
        np.testing.assert_allclose((mean[at], noise[at]), naive, rtol=1e-6)


def test_the_rest_of_the_empty_hand_is_found_in_each_session(tmp_path):
    baseline = {0: np.array([[514.2, 515.0]]), 1: np.array([[516.6, 513.4]])}
    parts = [(0, 0), (0, 1), (1, 0), (1, 1)]  # session and object of each recording of 2000 frames
    counts = np.concatenate(
        [resting(baseline[session] + 30 * held, 2000, seed=9 * held + session) for session, held in parts]
    )
    sessions, objects = (np.repeat(ids, 2000) for ids in zip(*parts, strict=True))
    with written(tmp_path / "t", counts, session=sessions, object=objects) as recordings:
        measured = empty_hand_baseline(recordings)
    assert measured.names == ["session0", "session1"]
    assert measured.mean.shape == measured.noise.shape == (2, 1, 2)
    np.testing.assert_allclose(measured.mean, [baseline[0], baseline[1]], atol=0.1)
    np.testing.assert_allclose(measured.noise, 0.99, atol=0.06)
    np.testing.assert_array_equal(measured.of_frame, sessions)


def test_a_session_that_no_frame_belongs_to_needs_no_empty_hand(tmp_path):
    counts = resting(np.full((1, 1), 514.0), 20)
    with written(tmp_path / "t", counts, sessions=["a", "b"]) as recordings:
        measured = empty_hand_baseline(recordings)
    assert measured.names == ["a", "b"]
    assert measured.mean[0].item() == pytest.approx(514, abs=1)
    assert np.isfinite(measured.mean).all() and (measured.noise > 0).all()


@pytest.mark.parametrize("empty", [0, 4])
def test_a_session_without_enough_of_the_empty_hand_is_named(tmp_path, empty):
    objects = np.r_[np.zeros(10), np.ones(10), np.zeros(empty), np.ones(10 - empty)]
    counts = resting(np.full((1, 2), 514.0), 30)
    sessions = np.repeat([0, 0, 1], 10)
    sentence = (
        rf"^session 'tuesday' has {empty} frames of 'empty_hand'; preprocess\.baseline empty_hand needs 5 or more: "
        "record the empty hand, or set it to auto$"
    )
    with (
        written(tmp_path / "t", counts, object=objects, session=sessions, sessions=["monday", "tuesday"]) as recordings,
        pytest.raises(UserError, match=sentence),
    ):
        empty_hand_baseline(recordings)


def test_five_frames_of_the_empty_hand_are_enough(tmp_path):
    counts = np.array([512, 513, 514, 515, 516, 900, 900], dtype=np.int16)[:, None, None]
    with written(tmp_path / "t", counts, object=np.repeat([0, 1], [5, 2])) as recordings:
        assert empty_hand_baseline(recordings).mean.item() == 514


def test_of_a_long_empty_hand_frames_from_its_first_to_its_last_are_measured(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MOST_FRAMES", 6)
    counts = np.full(16, 520, dtype=np.int16)
    counts[[0, 3, 6, 9, 12, 15]] = 514
    assert evenly(np.arange(16), 6).tolist() == [0, 3, 6, 9, 12, 15]
    assert evenly(np.arange(100, 106), 6).tolist() == list(range(100, 106))
    with written(tmp_path / "t", np.tile(counts[:, None, None], (1, 1, 2))) as recordings:
        measured = empty_hand_baseline(recordings)
    assert measured.mean.ravel().tolist() == [514, 514]


def test_quiet_frames_are_those_of_the_smallest_sum_in_each_recording(tmp_path):
    sums = np.r_[[9, 2, 8, 1, 7, 3, 6, 4, 5, 0, 2, 1], [90, 91, 92, 93, 94, 95, 96, 97, 98, 99, 99, 99]]
    counts = np.stack([sums, 500 + sums], axis=1)[:, None, :].astype(np.int16)
    with written(tmp_path / "t", counts, recording=np.repeat([0, 1], 12)) as recordings:
        measured = quiet_baseline(recordings, 0.5)
    assert measured.names == ["recording0", "recording1"]
    np.testing.assert_allclose(measured.mean[:, 0, 0], [(0 + 1 + 1 + 2 + 2 + 3) / 6, 92.5])
    np.testing.assert_allclose(measured.mean[:, 0, 1], [501.5, 592.5])
    assert measured.noise[1, 0, 0] == pytest.approx(np.std(np.arange(6)))
    np.testing.assert_array_equal(measured.of_frame, np.repeat([0, 1], 12))


def test_quiet_takes_five_frames_where_the_share_is_fewer_and_all_where_there_are_fewer(tmp_path):
    counts = np.r_[np.arange(20), [100, 102]].astype(np.int16)[:, None, None]
    with written(tmp_path / "t", counts, recording=np.repeat([0, 1], [20, 2])) as recordings:
        measured = quiet_baseline(recordings, 0.01)
    assert measured.mean.ravel().tolist() == [2, 101]


def test_no_rest_is_one_constant_for_every_frame(tmp_path):
    with written(tmp_path / "t", resting(np.full((3, 4), 514.0), 7), session=np.arange(7) % 2) as recordings:
        measured = constant_baseline(recordings, 500.0)
    assert measured.mean.shape == (1, 3, 4)
    assert (measured.mean == 500).all()
    assert measured.noise is None
    assert measured.of_frame.tolist() == [0] * 7


@pytest.mark.stag
@pytest.mark.parametrize(("name", "baseline"), [("blindfolded_lite", 513.9), ("weights_lite", 516.2)])
def test_the_rest_and_the_noise_of_the_real_files_are_as_measured(stag_data, name, baseline):
    blocks = read_metadata(stag_data / name / "metadata.mat").blocks
    counts = np.concatenate([block["pressure"][block["object"] == 0] for block in blocks])
    mean, noise = trimmed_moments(counts)
    assert mean[SENSORS].mean() == pytest.approx(baseline, abs=0.1)
    assert (mean[~SENSORS] == 510).all()
    assert 0.95 < noise[SENSORS].mean() < 1.4  # white noise, and the drift of the baseline during a recording
    white = trimmed_moments(np.diff(counts, axis=0))[1][SENSORS] / np.sqrt(2)
    assert 0.93 < white.mean() < 0.98


@settings(max_examples=25, deadline=None)
@given(st.integers(2, 60), st.integers(0, 10_000), st.sampled_from([np.int16, np.int32, np.float32, np.float64]))
def test_an_offset_takes_no_digits_of_mean_and_noise(frames, seed, kind):
    steps = np.random.default_rng(seed).integers(-20, 21, (frames, 1, 2))
    offset = {"i2": 30_000, "i4": 2 * 10**9, "f4": 2.0**22, "f8": 2.0**50}[np.dtype(kind).str[1:]]
    mean, noise = trimmed_moments((offset + steps).astype(kind))
    whole = kind in (np.int16, np.int32)
    plain, spread = trimmed_moments(steps.astype(np.int32 if whole else np.float64))  # of whole numbers the step is 1
    assert mean.dtype == (np.float32 if kind in (np.int16, np.float32) else np.float64)
    np.testing.assert_allclose(mean.astype(np.float64) - offset, plain, atol=np.spacing(mean).max() * 0.51)
    if whole:
        np.testing.assert_allclose(noise, spread, rtol=1e-6)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("unit", [1.0, 0.1, 5 / 1023])
def test_counts_kept_as_real_numbers_in_any_unit_have_the_noise_of_counts(unit, kind):
    counts = 500 + (np.random.default_rng(0).random((200, 2, 2)) < 0.3)
    counts[:, 0, 0] = 498
    mean, noise = trimmed_moments(counts.astype(np.int16))
    scaled = trimmed_moments((unit * counts).astype(kind))
    np.testing.assert_allclose(scaled[0], unit * mean, rtol=1e-6)
    np.testing.assert_allclose(scaled[1], unit * noise, rtol=1e-3)
    assert noise[0, 0] == pytest.approx(12**-0.5)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("value", [0.1, 1e-30, 1e30, 0.0, -7.3])
def test_a_real_sensor_that_never_varies_has_its_value_and_the_noise_of_its_last_digit(value, kind):
    mean, noise = trimmed_moments(np.full((50, 1, 1), value, dtype=kind))
    assert mean.item() == kind(value)
    assert noise.item() == pytest.approx(12**-0.5 * float(np.spacing(np.abs(kind(value)))), rel=1e-6)
