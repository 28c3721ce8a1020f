"""p values of paired differences, by flipping the signs of whole split groups, and Holm's correction."""

import numpy as np

from tactile_viewgcn.intervals import DRAWN_AT_ONCE

MAX_FLIPS = 10_000
ROUNDED = 9  # digits of a sum of signed shares


def sign_flip(difference: np.ndarray, groups: np.ndarray, rng: np.random.Generator) -> float:
    """p value of a paired difference (A,) against mean 0, by flipping the signs of whole groups' sums.

    Two-sided, from all 2^G flips of G groups, or from 10,000 draws where there are more (Good 2005, "Permutation,
    parametric and bootstrap tests of hypotheses", section 3.2). It is never below 2 / 2^G, so few groups show little,
    and like `group_interval` it is conditional on the trainings.
    """
    from scipy.stats import permutation_test  # here, since it loads slowly

    sums = np.bincount(np.unique(groups, return_inverse=True)[1].ravel(), weights=difference)
    if len(sums) < 2 or not sums.any():
        return 1.0
    shares = sums / np.abs(sums).sum()
    test = permutation_test(
        (shares,),
        lambda flipped, axis: flipped.sum(axis).round(ROUNDED),  # a sum must not depend on the order of its terms
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
