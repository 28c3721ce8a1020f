"""Median and tail, calibration error."""

import numpy as np

BINS = 15  # of Guo et al.


def median_and_p95(values: np.ndarray) -> dict[str, float]:
    """Median and 95th percentile of values (n,), n at least 1, interpolated between neighbours."""
    return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95))}


def calibration_error(confidence: np.ndarray, correct: np.ndarray) -> float:
    """Expected calibration error (Guo et al. 2017, equation 3).

    The mean over the answers of |mean confidence - share of correct answers| of their bin, of 15 of equal width.

    Args:
        confidence: (n,) probability of the answer; correct: bool (n,).
    """
    bins = np.minimum((confidence * BINS).astype(int), BINS - 1)
    excess = np.bincount(bins, confidence.astype(np.float64) - correct, BINS)
    return float(np.abs(excess).sum() / len(confidence))
