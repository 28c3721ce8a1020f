"""The baseline of each sensor."""

import numpy as np

from tactile_viewgcn.frames.baseline import measure_baseline
from tactile_viewgcn.frames.moments import (
    ROUNDING_SD,
    session_moments,
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
