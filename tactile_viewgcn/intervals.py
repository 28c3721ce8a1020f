"""Computes intervals of errors by resampling split groups, since frames of a group are alike."""

import numpy as np

RESAMPLES = 2000
OUTSIDE = 0.05  # share of the resampled means outside an interval
FEW = 10  # groups; an interval of fewer groups says little, and decides no comparison
DRAWN_AT_ONCE = 2_000_000  # groups of all resamples that are in memory together


def group_interval(
    values: np.ndarray, groups: np.ndarray, rng: np.random.Generator
) -> tuple[float, float] | None:
    """Return the 95 % interval of a mean, by resampling groups.

    Each group is weighted by its number of values. The source is Davison and Hinkley, "Bootstrap
    methods and their application" (1997), section 3.8, the strategy that resamples only groups.

    Args:
        values: (A,) a value for each anchor's view set, such as the share of trials in which it is
            answered wrongly.
        groups: (A,) the anchor's split group.
        rng: draws the groups.

    Returns:
        The 2.5th and the 97.5th percentile of 2,000 resampled means. None with fewer than two
        groups, which do not show how groups differ.
    """
    from scipy.stats import bootstrap  # here, since it loads slowly

    _, place, sizes = np.unique(groups, return_inverse=True, return_counts=True)
    if len(sizes) < 2:
        return None
    sums = np.bincount(place.ravel(), weights=values)
    ends = bootstrap(
        (sums, sizes),
        _weighted_mean,
        paired=True,
        n_resamples=RESAMPLES,
        batch=max(1, DRAWN_AT_ONCE // len(sizes)),
        confidence_level=1 - OUTSIDE,
        method="percentile",
        rng=rng,
    ).confidence_interval
    return float(ends.low), float(ends.high)


def _weighted_mean(sums: np.ndarray, sizes: np.ndarray, axis: int) -> np.ndarray:
    """Return the mean of all values, from each group's sum and number of values."""
    mean: np.ndarray = sums.sum(axis) / sizes.sum(axis)
    return mean


def proportion_interval(
    values: np.ndarray, groups: np.ndarray, rng: np.random.Generator
) -> tuple[float, float] | None:
    """Return the 95 % interval of a share, wide enough even if all G groups are without a mistake.

    Resampling G groups cannot show a mistake that no group made. Hence the result of
    `group_interval` is extended up to 1 - 0.025^(1/G) at least, and down to 0.025^(1/G) at least.
    These ends are from Clopper and Pearson (1934), for G trials that are all right, and for G
    trials that are all wrong. Hence one wrong view set never raises the lower end. The interval can
    still be narrow, for instance if the share is one half in every group.

    Args:
        values: (A,) see `group_interval`.
        groups: (A,) the anchor's split group.
        rng: draws the groups.

    Returns:
        Both ends; None with fewer than two groups.
    """
    interval = group_interval(values, groups, rng)
    if not interval:
        return None
    low, high = interval
    unseen = unseen_share(groups)
    return min(low, 1 - unseen), max(high, unseen)


def unseen_share(groups: np.ndarray) -> float:
    """Return the largest share of mistakes that all groups together can fail to show.

    Args:
        groups: (A,) split group of each answer.
    """
    return float(1 - (OUTSIDE / 2) ** (1 / len(np.unique(groups))))


def percent_interval(value: float, low: float | None, high: float | None) -> str:
    """Return a fraction and its interval in per cent: `48.2 (39.0 to 57.8)`, or only `48.2`.

    Args:
        value: the fraction.
        low: lower end of its interval; None if there is no interval.
        high: upper end of its interval.
    """
    text = f"{100 * value:.1f}"
    if low is None or high is None:
        return text
    return f"{text} ({100 * low:.1f} to {100 * high:.1f})"


def percent(share: float) -> str:
    """Return a share in per cent, as one word: 47.3 %."""
    return f"{100 * share:.1f}\N{NO-BREAK SPACE}%"
