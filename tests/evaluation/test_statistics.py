"""The error of a calibration; the median and the tail."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.stability.rows import max_rel_error
from tactile_viewgcn.evaluation.statistics import calibration_error, median_and_p95

DIGITS = 1e-12  # of double precision


def test_the_calibration_error_by_hand():
    confidence = np.array([0.95, 0.95, 0.05, 0.5])
    correct = np.array([True, False, False, True])
    assert calibration_error(confidence, correct) == pytest.approx((0.9 + 0.05 + 0.5) / 4)
    assert calibration_error(np.ones(3), np.ones(3, dtype=bool)) == 0
    assert calibration_error(np.zeros(3), np.ones(3, dtype=bool)) == 1
    assert calibration_error(np.array([1.0, 0.99]), np.array([False, True])) == pytest.approx((1 - 0.01) / 2)  # one bin
    assert calibration_error(np.array([1.0, 0.9]), np.array([False, True])) == pytest.approx((1 + 0.1) / 2)  # two


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
    for number in range(15):
        chosen = bins == number
        if chosen.any():
            total += chosen.mean() * abs(confidence[chosen].mean() - correct[chosen].mean())
    assert calibration_error(confidence, correct) == pytest.approx(total, abs=1e-12)


@pytest.mark.stability("percentiles")
@pytest.mark.parametrize(
    ("times", "median", "p95"),
    [
        ([7.0], 7, 7),
        ([1.0, 3.0], 2, 2.9),
        ([1e-9, 2.0, 1e9], 2, 9e8 + 0.2),
        (np.arange(50.0) ** 2, 600.5, 2167.15),
    ],
)
def test_the_median_and_the_tail_of_few_values_by_hand(row, times, median, p95):
    values = median_and_p95(np.random.default_rng(0).permutation(times))
    row(f"median of {len(times)}", max_rel_error(values["median"], median), DIGITS)
    row(f"p95 of {len(times)}", max_rel_error(values["p95"], p95), DIGITS)
