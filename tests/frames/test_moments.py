"""The mean, the noise and the drift of a session's open hand."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.frames.moments import (
    ROUNDING_SD,
    Moments,
    session_moments,
    trimmed_moments,
    visible_noise,
)
from tests.glove_data import NOISE, SD, drifting, of_arrays, written


def test_each_sensor_loses_its_own_outliers_and_no_other_s():
    drawn = np.random.default_rng(0).normal(514, NOISE, (60, 2, 2))
    counts = np.rint(drawn).astype(np.int16)
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


def test_moments_have_the_drift_that_is_known_at_least():
    noise = np.array([3.0, 3.0])
    moments = Moments(np.zeros(2), noise, np.array([3.0, 9.0]), drift=1.0)
    drifted = moments.with_drift(4.0)
    assert drifted.drift == 4
    np.testing.assert_allclose(drifted.session_noise, [5, 9])
    less = moments.with_drift(0.5)
    assert less.drift == 1
    np.testing.assert_allclose(less.session_noise, [9.25**0.5, 9])


@pytest.mark.parametrize("recordings", [2, 4])
def test_a_bump_of_the_empty_hand_is_no_noise_and_no_drift(tmp_path, recordings):
    glove = drifting(objects=3, recordings=recordings)
    bumped = glove.columns["recording"] == 1
    counts = glove.counts.copy()
    counts[np.flatnonzero(bumped)[:15]] += 300
    (moments,) = session_moments(replace(glove, counts=counts).table(tmp_path / "t"))
    np.testing.assert_allclose(moments.noise, SD, atol=0.15)
    assert moments.drift < 1


def test_noise_that_is_cut_off_is_measured_in_each_recording_of_the_empty_hand(tmp_path):
    rng = np.random.default_rng(0)
    recording = np.repeat([0, 1], 500)
    counts = np.maximum(rng.normal(0, 4, (1000, 4, 5)), 0)
    recordings = written(tmp_path / "t", counts, recording=recording, object=0)
    (moments,) = session_moments(recordings)
    np.testing.assert_allclose(np.median(moments.noise), 4, rtol=0.25)


def test_a_sensor_that_is_constant_in_each_recording_has_the_noise_of_rounding(tmp_path):
    """The middle of the other sensor is half a count, which is no step of the readings."""
    counts = np.full((80, 2, 1), 510)
    counts[:, 1] = np.tile([500, 501, 502, 503], 20)[:, None]
    recording = np.repeat([0, 1], 40)
    counts[recording == 1] += 3
    recordings = written(tmp_path / "t", counts.astype(np.int16), recording=recording, object=0)
    (moments,) = session_moments(recordings)
    np.testing.assert_allclose(moments.noise, [ROUNDING_SD, 1.25**0.5], rtol=1e-6)


def test_short_recordings_of_the_empty_hand_have_the_noise_of_their_session(tmp_path):
    rng = np.random.default_rng(0)
    recording = np.repeat(np.arange(6), 20)
    drift = 40 * recording[:, None, None]
    counts = np.rint(500 + drift + rng.normal(0, 3, (len(recording), 4, 5))).astype(np.int16)
    (moments,) = session_moments(written(tmp_path / "t", counts, recording=recording, object=0))
    np.testing.assert_array_equal(moments.noise, moments.session_noise)
    assert moments.drift == 0


def noise_of(readings):
    """Return the noise (S,) of recordings (R, T, H, W) without an empty hand."""
    count = len(readings)
    table = of_arrays(list(readings), ["ball"], np.zeros(count, int), np.zeros(count, int))
    (moments,) = session_moments(table)
    assert moments.mean is None
    return moments.noise


@pytest.mark.parametrize("noise", [0.07, 0.15, 0.6, 3.0])
def test_without_an_empty_hand_the_noise_is_the_same_for_counts_and_volts_and_covers_a_step(noise):
    """A reading that differs by one step is below three fifths of five standard deviations."""
    rng = np.random.default_rng(0)
    counts = rng.normal(850.3, noise, (4, 50, 6, 6)).round()
    expected = noise_of(counts.astype(np.int16))
    assert (0.6 * 5 * expected > 1).all()
    if noise > 0.5:
        np.testing.assert_allclose(np.median(expected), np.hypot(noise, ROUNDING_SD), rtol=0.1)
    step = 3.3 / 1023
    np.testing.assert_allclose(noise_of(counts * step), expected * step, rtol=1e-4)
    in_32_bits = noise_of((counts / 1023).astype(np.float32))
    np.testing.assert_allclose(in_32_bits, expected / 1023, rtol=1e-3)
