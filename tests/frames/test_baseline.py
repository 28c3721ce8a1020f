"""The baseline of each sensor."""

import numpy as np
import pytest

from tactile_viewgcn.frames.baseline import (
    ROUNDING_SD,
    measure_baseline,
    session_moments,
    trimmed_moments,
    visible_noise,
)
from tactile_viewgcn.params import PreprocessSection
from tests.glove_data import written

SD = 0.95  # counts


def resting(baseline, frames, seed=0):
    """Return whole counts of untouched sensors: `baseline` (H, W) with Gaussian noise."""
    noise = np.random.default_rng(seed).normal(0, SD, size=(frames, *np.shape(baseline)))
    return np.round(baseline + noise).astype(np.int16)


def test_the_baseline_of_each_session_is_estimated_to_a_twentieth_of_a_count_below_outliers(
    tmp_path,
):
    baseline = np.array([[[514.3, 515.0]], [[516.5, 513.8]]])
    session_and_label = [(0, 0), (0, 1), (1, 0), (1, 1)]  # of each recording
    counts = np.concatenate(
        [
            resting(baseline[session] + 30 * label, 5000, session)
            for session, label in session_and_label
        ]
    )
    sessions, objects = np.repeat(session_and_label, 5000, axis=0).T
    counts[np.random.default_rng(1).random(counts.shape) < 0.01] += 20
    recordings = written(tmp_path / "t", counts, session=sessions, object=objects)
    second = recordings.part(np.flatnonzero(sessions))
    section = PreprocessSection(baseline="empty_hand")
    measured = measure_baseline(recordings, section, session_moments(recordings))
    alone = measure_baseline(second, section, session_moments(second))
    assert measured.mean.shape == (2, 1, 2)
    assert measured.mean.dtype == np.float32
    assert measured.noise.dtype == np.float32
    np.testing.assert_array_equal(alone.mean[0], measured.mean[1])
    np.testing.assert_array_equal(alone.noise[0], measured.noise[1])
    np.testing.assert_allclose(measured.mean, baseline, atol=0.05)
    np.testing.assert_allclose(measured.noise, np.hypot(SD, ROUNDING_SD), atol=0.05)
    np.testing.assert_array_equal(measured.of_frame, sessions)


def test_each_sensor_loses_its_own_outliers_and_no_other_s():
    counts = resting(np.full((2, 2), 514.0), 60)
    # the smallest is an outlier only after the other two are left out
    counts[:3, 0, 0] += np.array([400, 30, 9], dtype=np.int16)
    mean, noise = trimmed_moments(counts)
    kept = [counts[3:, 0, 0], counts[:, 0, 1], counts[:, 1, 0], counts[:, 1, 1]]
    expected_mean = [readings.mean() for readings in kept]
    np.testing.assert_allclose(mean.ravel(), expected_mean, rtol=1e-6)
    expected_noise = [readings.std() for readings in kept]
    np.testing.assert_allclose(noise.ravel(), expected_noise, rtol=1e-5)


def test_noise_that_is_cut_off_at_the_smallest_reading_is_measured_as_if_it_were_whole():
    noise = np.random.default_rng(0).normal(0, 3, (4000, 9))
    for counts in (noise, np.maximum(noise, 0)):
        _, measured = trimmed_moments(counts, visible_noise(counts))
        np.testing.assert_allclose(measured, 3, rtol=0.25)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("digits", [0, 1, 2, 4])
@pytest.mark.parametrize("step", [0.1, 0.7, 1 / 3])
def test_the_step_of_readings_in_tenths_is_a_tenth_though_they_differ_in_the_last_digits(
    dtype, digits, step
):
    """A sensor that never changes has the variance of rounding, a twelfth of a step squared.

    The step is known from other sensors.
    """
    rng = np.random.default_rng(0)
    readings = (step * rng.integers(0, 100, (400, 3))).astype(dtype)
    readings[:, 0] = dtype(40 * step)
    readings[1::2] += (digits * np.spacing(readings[1::2])).astype(dtype)  # computed in another way
    _, noise = trimmed_moments(readings)
    np.testing.assert_allclose(noise[0], ROUNDING_SD * step, rtol=1e-4)
