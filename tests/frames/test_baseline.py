"""The baseline of each sensor."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.frames.baseline import (
    MAX_PASSES,
    OUTLIER_SD,
    ROUNDING_SD,
    measure_baseline,
    session_moments,
    trimmed_moments,
)
from tactile_viewgcn.params import PreprocessSection
from tests.glove_data import written

SD = 0.95  # counts


def resting(baseline, frames, seed=0):
    """Whole counts of sensors at `baseline` (H, W), with Gaussian noise."""
    noise = np.random.default_rng(seed).normal(0, SD, size=(frames, *np.shape(baseline)))
    return np.round(baseline + noise).astype(np.int16)


def test_the_baseline_of_each_session_is_estimated_to_a_twentieth_of_a_count_below_outliers(tmp_path):
    baseline = np.array([[[514.3, 515.0]], [[516.5, 513.8]]])
    parts = [(0, 0), (0, 1), (1, 0), (1, 1)]  # session and object of each recording
    counts = np.concatenate([resting(baseline[session] + 30 * label, 5000, session) for session, label in parts])
    sessions, objects = (np.repeat(ids, 5000) for ids in zip(*parts, strict=True))
    counts[np.random.default_rng(1).random(counts.shape) < 0.01] += 20
    recordings = written(tmp_path / "t", counts, session=sessions, object=objects)
    second = recordings.part(np.flatnonzero(sessions))
    kind = PreprocessSection(baseline="empty_hand")
    measured, alone = (measure_baseline(one, kind, session_moments(one)) for one in (recordings, second))
    assert (measured.mean.shape, measured.mean.dtype, measured.noise.dtype) == ((2, 1, 2), np.float32, np.float32)
    np.testing.assert_array_equal((alone.mean[0], alone.noise[0]), (measured.mean[1], measured.noise[1]))
    np.testing.assert_allclose(measured.mean, baseline, atol=0.05)
    np.testing.assert_allclose(measured.noise, np.hypot(SD, ROUNDING_SD), atol=0.05)
    np.testing.assert_array_equal(measured.of_frame, sessions)


def _trimmed_one(values):
    """Mean and standard deviation of one sensor without outliers, value by value."""
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
