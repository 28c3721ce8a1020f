"""The baseline of each sensor."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.frames.baseline import (
    MAX_PASSES,
    OUTLIER_SD,
    ROUNDING_SD,
    empty_hand_baseline,
    trimmed_moments,
)
from tests.glove_data import written

FRAMES = 10_000


def resting(baseline, frames, seed=0):
    """Whole counts of sensors at `baseline` (H, W), Gaussian noise of sd 0.95 on them."""
    noise = np.random.default_rng(seed).normal(0, 0.95, size=(frames, *np.shape(baseline)))
    return np.round(baseline + noise).astype(np.int16)


@pytest.mark.parametrize("fraction", [0.0, 0.3, 0.5, 0.8])
def test_a_known_baseline_is_estimated_to_a_twentieth_of_a_count_below_outliers(fraction):
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


def test_the_baseline_of_the_empty_hand_is_estimated_in_each_session(tmp_path):
    baseline = {0: np.array([[514.2, 515.0]]), 1: np.array([[516.6, 513.4]])}
    parts = [(0, 0), (0, 1), (1, 0), (1, 1)]  # session and object of each recording of 2000 frames
    counts = np.concatenate(
        [resting(baseline[session] + 30 * held, 2000, seed=9 * held + session) for session, held in parts]
    )
    sessions, objects = (np.repeat(ids, 2000) for ids in zip(*parts, strict=True))
    recordings = written(tmp_path / "t", counts, session=sessions, object=objects)
    measured = empty_hand_baseline(recordings)
    assert measured.names == ["session0", "session1"]
    assert measured.mean.shape == measured.noise.shape == (2, 1, 2)
    np.testing.assert_allclose(measured.mean, [baseline[0], baseline[1]], atol=0.1)
    np.testing.assert_allclose(measured.noise, 0.99, atol=0.06)
    np.testing.assert_array_equal(measured.of_frame, sessions)


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
