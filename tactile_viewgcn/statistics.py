"""Intervals that know that frames of one group resemble each other."""

import numpy as np

RESAMPLES = 2000
FLIPS = 10_000


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


def sign_flip(difference: np.ndarray, groups: np.ndarray, rng: np.random.Generator) -> float:
    """p that a paired difference (A,) has mean 0: by turning the signs of whole groups' sums at random.

    Two-sided, from 10,000 draws (Good 2005, "Permutation, parametric and bootstrap tests of hypotheses", section 3.2);
    never below 1 in 10,001. Like `group_interval` it is conditional on the trainings.
    """
    sums = np.bincount(np.unique(groups, return_inverse=True)[1].ravel(), weights=difference)
    signs = rng.choice([-1.0, 1.0], size=(FLIPS, len(sums)))
    slack = 1e-9 * np.abs(sums).sum()  # sums in another order are equal
    return float((1 + (np.abs(signs @ sums) >= abs(sums.sum()) - slack).sum()) / (1 + FLIPS))


def holm(ps: list[float]) -> list[float]:
    """p values corrected for their number (Holm 1979), in the order given."""
    corrected, largest = [0.0] * len(ps), 0.0
    for rank, place in enumerate(np.argsort(ps, kind="stable")):
        largest = max(largest, min(1.0, (len(ps) - rank) * ps[place]))
        corrected[place] = largest
    return corrected
