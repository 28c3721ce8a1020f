"""Intervals that resample split groups, whose frames resemble each other."""

from math import ceil, log

import numpy as np

RESAMPLES = 2000
OUTSIDE = 0.05  # of an interval


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
    low, high = np.percentile(means, [100 * OUTSIDE / 2, 100 - 100 * OUTSIDE / 2])
    return float(low), float(high)


def proportion_interval(
    correct: np.ndarray, groups: np.ndarray, rng: np.random.Generator
) -> tuple[float, float] | None:
    """95 % interval of a share: `group_interval`, made to reach down to 0.025^(1/G) and up to 1 - 0.025^(1/G).

    Resampling G groups cannot show what none of them did. The ends are those of Clopper and Pearson (1934) for G trials
    that are all right, and all wrong: one wrong view set must not raise the low end above what it is without any. The
    interval may still be narrow, as around a share of a half in every group.

    Args:
        correct, groups: (A,), see `group_interval`.
    """
    interval = group_interval(correct, groups, rng)
    if not interval:
        return None
    unseen = unseen_share(len(np.unique(groups)))
    return min(interval[0], 1 - unseen), max(interval[1], unseen)


def unseen_share(groups: int) -> float:
    """The largest share of mistakes that as many groups without one leave possible: 1 - 0.025^(1/G)."""
    return 1 - (OUTSIDE / 2) ** (1 / groups)


def groups_for(share: float) -> int:
    """The fewest groups whose `unseen_share` is at most `share`."""
    return ceil(log(OUTSIDE / 2) / log(1 - share))
