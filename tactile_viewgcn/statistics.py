"""Intervals that know that frames of one group resemble each other."""

import numpy as np

RESAMPLES = 2000


def group_interval(correct: np.ndarray, groups: np.ndarray, rng: np.random.Generator) -> tuple[float, float] | None:
    """95 % interval of the mean of `correct`, by resampling groups and, inside each, its view sets.

    Args:
        correct: (A,) share of the trials in which each anchor's view set is right.
        groups: (A,) the anchor's split group.

    Returns:
        The 2.5th and 97.5th percentile of 2,000 resampled means (Davison & Hinkley 1997, section 3.8); None
        with fewer than two groups, which say nothing of how groups differ.
    """
    order = np.argsort(groups, kind="stable")
    _, start, size = np.unique(groups[order], return_index=True, return_counts=True)
    if len(size) < 2:
        return None
    ordered, means = correct[order], np.empty(RESAMPLES)
    for number in range(RESAMPLES):
        chosen = rng.integers(len(size), size=len(size))
        width = np.repeat(size[chosen], size[chosen])
        inside = (rng.random(len(width)) * width).astype(np.int64)
        means[number] = ordered[np.repeat(start[chosen], size[chosen]) + inside].mean()
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)
