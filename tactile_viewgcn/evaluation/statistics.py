"""Tests of paired differences that resample split groups; confusion; calibration error."""

import numpy as np

from tactile_viewgcn.intervals import DRAWN_AT_ONCE

BINS = 15  # of Guo et al.
MAX_FLIPS = 10_000
ROUNDED = 9  # digits of a sum of signed shares


def sign_flip(difference: np.ndarray, groups: np.ndarray, rng: np.random.Generator) -> float:
    """p that a paired difference (A,) has mean 0: by turning the signs of whole groups' sums.

    Two-sided, from all 2^G ways where G groups have no more than 10,000, else from as many draws (Good 2005,
    "Permutation, parametric and bootstrap tests of hypotheses", section 3.2). It is never below 2 / 2^G, so that few
    groups cannot show much, and like `group_interval` it is conditional on the trainings.
    """
    from scipy.stats import permutation_test  # here, for it loads slowly

    sums = np.bincount(np.unique(groups, return_inverse=True)[1].ravel(), weights=difference)
    if len(sums) < 2 or not sums.any():
        return 1.0
    shares = sums / np.abs(sums).sum()
    test = permutation_test(
        (shares,),
        lambda flipped, axis: flipped.sum(axis).round(ROUNDED),  # sums in another order are equal
        permutation_type="samples",
        n_resamples=MAX_FLIPS,
        batch=max(1, DRAWN_AT_ONCE // len(sums)),
        rng=rng,
    )
    return float(test.pvalue)


def holm(ps: list[float]) -> list[float]:
    """p values corrected for their number (Holm 1979), in the order of `ps`."""
    corrected, largest = [0.0] * len(ps), 0.0
    for rank, place in enumerate(np.argsort(ps, kind="stable")):
        largest = max(largest, min(1.0, (len(ps) - rank) * ps[place]))
        corrected[place] = largest
    return corrected


def median_and_p95(values: np.ndarray) -> dict[str, float]:
    """Median and 95th percentile of values (n,), n at least 1, interpolated between neighbours."""
    return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95))}


def confusion_counts(labels: np.ndarray, predicted: np.ndarray, classes: int) -> np.ndarray:
    """int64 (classes, classes): how often each class, a row, was answered with each, a column.

    Args:
        labels: (A,) true classes; predicted: (..., A).
    """
    cells = np.broadcast_to(labels.astype(np.int64), predicted.shape) * classes + predicted
    return np.bincount(cells.ravel(), minlength=classes**2).reshape(classes, classes)


def calibration_error(confidence: np.ndarray, correct: np.ndarray) -> float:
    """Expected calibration error (Guo et al. 2017, equation 3).

    The mean over the answers of |mean confidence - share of correct answers| of their bin, of 15 of equal width.

    Args:
        confidence: (n,) probability of the answer that is given; correct: bool (n,).
    """
    bins = np.minimum((confidence * BINS).astype(int), BINS - 1)
    excess = np.bincount(bins, confidence.astype(np.float64) - correct, BINS)
    return float(np.abs(excess).sum() / len(confidence))
