"""Intervals of errors that resample split groups, since the frames of a group resemble each other."""

import numpy as np

RESAMPLES = 2000
OUTSIDE = 0.05  # share of the resampled means outside an interval
FEW = 10  # groups: an interval of fewer says little
DRAWN_AT_ONCE = 2_000_000  # groups of the resamples that are in memory


def group_interval(
    values: np.ndarray, groups: np.ndarray, rng: np.random.Generator
) -> tuple[float, float] | None:
    """95 % interval of the mean of `values`, by resampling groups, each weighted by its number of values.

    Args:
        values: (A,) a value of each anchor's view set, such as the share of the trials in which it
            is wrong.
        groups: (A,) the anchor's split group.

    Returns:
        The 2.5th and 97.5th percentile of 2,000 resampled means (Davison & Hinkley 1997, section
            3.8, the strategy
        that resamples groups alone); None with fewer than two groups, from which their differences
            are unknown.
    """
    from scipy.stats import bootstrap  # here, since it loads slowly

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


def proportion_interval(
    values: np.ndarray, groups: np.ndarray, rng: np.random.Generator
) -> tuple[float, float] | None:
    """95 % interval of a share: `group_interval`, extended down to 0.025^(1/G) and up to 1 - 0.025^(1/G).

    Resampling G groups shows no mistake that none of them made. The ends are those of Clopper and
    Pearson (1934) for G trials that are all right, and for G that are all wrong, so that one wrong
    view set never raises the low end. The interval may still be narrow, for instance around a share
    of one half in every group.

    Args:
        values, groups: (A,), see `group_interval`.
    """
    interval = group_interval(values, groups, rng)
    if not interval:
        return None
    # largest share of mistakes that groups may not show
    unseen = 1 - (OUTSIDE / 2) ** (1 / len(np.unique(groups)))
    return min(interval[0], 1 - unseen), max(interval[1], unseen)


def percent_interval(value: float, low: float | None, high: float | None) -> str:
    """A fraction and its interval in per cent, `48.2 (39.0 to 57.8)`; without an interval `48.2`."""
    text = f"{100 * value:.1f}"
    return text if low is None or high is None else f"{text} ({100 * low:.1f} to {100 * high:.1f})"
