"""Intervals that resample split groups, whose frames resemble each other."""

import numpy as np

RESAMPLES = 2000
OUTSIDE = 0.05  # of an interval
DRAWN_AT_ONCE = 2_000_000  # groups, of the resamples that are in memory


def group_interval(values: np.ndarray, groups: np.ndarray, rng: np.random.Generator) -> tuple[float, float] | None:
    """95 % interval of the mean of `values`, by resampling groups; a group weighs as much as it has values.

    Args:
        values: (A,) of each anchor's view set, such as the share of the trials in which it is wrong.
        groups: (A,) the anchor's split group.

    Returns:
        The 2.5th and 97.5th percentile of 2,000 resampled means (Davison & Hinkley 1997, section 3.8, the strategy
        that resamples groups alone); None with fewer than two groups, which say nothing of how groups differ.
    """
    from scipy.stats import bootstrap  # here, for it loads slowly

    _, place, sizes = np.unique(groups, return_inverse=True, return_counts=True)
    if len(sizes) < 2:
        return None
    ends = bootstrap(
        (np.bincount(place.ravel(), weights=values), sizes),
        lambda sums, sizes, axis: sums.sum(axis) / sizes.sum(axis),
        paired=True,
        n_resamples=RESAMPLES,
        batch=max(1, DRAWN_AT_ONCE // len(sizes)),
        confidence_level=1 - OUTSIDE,
        method="percentile",
        rng=rng,
    ).confidence_interval
    return float(ends.low), float(ends.high)


def proportion_interval(values: np.ndarray, groups: np.ndarray, rng: np.random.Generator) -> tuple[float, float] | None:
    """95 % interval of a share: `group_interval`, made to reach down to 0.025^(1/G) and up to 1 - 0.025^(1/G).

    Resampling G groups cannot show what none of them did. The ends are those of Clopper and Pearson (1934) for G trials
    that are all right, and all wrong: one wrong view set must not raise the low end above what it is without any. The
    interval may still be narrow, as around a share of a half in every group.

    Args:
        values, groups: (A,), see `group_interval`.
    """
    interval = group_interval(values, groups, rng)
    if not interval:
        return None
    unseen = 1 - (OUTSIDE / 2) ** (1 / len(np.unique(groups)))  # the most mistakes that groups without one allow
    return min(interval[0], 1 - unseen), max(interval[1], unseen)


def percent_interval(value: float, low: float | None, high: float | None) -> str:
    """A fraction and its interval in per cent: `48.2 (39.0 to 57.8)`; `48.2` where there is no interval."""
    text = f"{100 * value:.1f}"
    return text if low is None or high is None else f"{text} ({100 * low:.1f} to {100 * high:.1f})"
