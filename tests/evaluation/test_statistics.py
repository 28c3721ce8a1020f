"""The error of a calibration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.evaluation.statistics import calibration_error, median_and_p95

DIGITS = 1e-12  # of double precision


@pytest.mark.parametrize(("below", "error"), [(0.99, (1 - 0.01) / 2), (0.9, (1 + 0.1) / 2)], ids=["one bin", "two"])
def test_a_confidence_of_1_is_in_the_last_bin(below, error):
    assert calibration_error(np.array([1.0, below]), np.array([False, True])) == pytest.approx(error)


@pytest.mark.stability("calibration")
def test_the_calibration_error_of_one_bin_is_how_far_confidence_is_from_the_share_correct(row):
    correct = np.arange(10) < 7
    for confidence in (0.0, 0.3, 1 / 3, 0.7, 1.0):  # at the ends of bins
        error = calibration_error(np.full(10, confidence, dtype=np.float32), correct)
        row(f"one bin, confidence {confidence:.3g}", abs(error - abs(confidence - 0.7)), 1e-7)
    row("one answer", abs(calibration_error(np.array([0.6]), np.array([True])) - 0.4), DIGITS)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0, 1), min_size=1, max_size=60), st.integers(0, 1000))
def test_the_calibration_error_is_that_of_a_loop_over_the_bins(confidence, seed):
    confidence, total = np.array(confidence), 0.0
    correct = np.random.default_rng(seed).random(len(confidence)) < confidence
    bins = np.minimum(np.floor(confidence * 15), 14)
    for chosen in (bins == number for number in np.unique(bins)):
        total += chosen.mean() * abs(confidence[chosen].mean() - correct[chosen].mean())
    assert calibration_error(confidence, correct) == pytest.approx(total, abs=1e-12)


def test_the_median_and_the_95th_percentile_by_hand():
    assert median_and_p95(np.array([3.0, 1.0])) == pytest.approx({"median": 2, "p95": 2.9})
    assert median_and_p95(np.arange(50.0)[::-1] ** 2) == pytest.approx({"median": 600.5, "p95": 2167.15})
