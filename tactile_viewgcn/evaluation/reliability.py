"""Measures how well the probabilities of answers agree with how often the answers are right."""

from typing import Any

import numpy as np

from tactile_viewgcn.intervals import group_interval, proportion_interval

BINS = 5
FEWEST = 10  # answers in a bin, on average


def reliability(
    probabilities: np.ndarray, correct: np.ndarray, groups: np.ndarray, rng: np.random.Generator
) -> dict[str, Any]:
    """Compare the probabilities of answers with the share of right answers.

    The probability of an answer is that of its most probable class. Its quantiles divide the
    answers into bins, so equal probabilities are in one bin. The source is Guo et al., "On
    calibration of modern neural networks" (arXiv 1706.04599), section 2, whose bins are of equal
    width instead. With few answers the expected calibration error is above 0 even if the
    probabilities are exact.

    Args:
        probabilities: (A, classes) of each answer.
        correct: bool (A,), whether the answer is right.
        groups: (A,) split groups of the answers.
        rng: draws the resampled groups of the intervals.

    Returns:
        As fractions: `probability`, the mean over all answers. `excess`, by how much it is above
            the share of right answers: `mean`, `low` and `high`. `calibration_error`, the mean
            difference within the bins. `bins`, from low to high probabilities: the number of
            `answers`, their mean `probability`, and the share `right` with `low` and `high`.
            The ends of intervals are None if there is only one group.
    """
    confidence = probabilities.max(axis=1).astype(np.float64)
    right = correct.astype(np.float64)
    excess = confidence - right
    low, high = group_interval(excess, groups, rng) or (None, None)
    count = min(BINS, max(1, len(right) // FEWEST))
    edges = np.quantile(confidence, np.arange(1, count) / count)
    bin_of = np.searchsorted(edges, confidence)
    bins = [np.flatnonzero(bin_of == number) for number in np.unique(bin_of)]
    return {
        "probability": float(confidence.mean()),
        "excess": {"mean": float(excess.mean()), "low": low, "high": high},
        "calibration_error": float(sum(abs(excess[index].sum()) for index in bins) / len(excess)),
        "bins": [_bin(confidence[index], right[index], groups[index], rng) for index in bins],
    }


def _bin(
    confidence: np.ndarray, right: np.ndarray, groups: np.ndarray, rng: np.random.Generator
) -> dict[str, Any]:
    low, high = proportion_interval(right, groups, rng) or (None, None)
    return {
        "answers": len(right),
        "probability": float(confidence.mean()),
        "right": {"mean": float(right.mean()), "low": low, "high": high},
    }
