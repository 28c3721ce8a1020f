"""Whether paired differences could be chance, and the correction for asking often."""

from itertools import product

import numpy as np

FLIPS = 10_000


def sign_flip(difference: np.ndarray, groups: np.ndarray, rng: np.random.Generator) -> float:
    """p that a paired difference (A,) has mean 0: by turning the signs of whole groups' sums.

    Two-sided, from all 2^G ways where G groups have no more than 10,000, else from as many draws (Good 2005,
    "Permutation, parametric and bootstrap tests of hypotheses", section 3.2). It is never below 2 / 2^G, so that few
    groups cannot show much, and like `statistics.group_interval` it is conditional on the trainings.
    """
    sums = np.bincount(np.unique(groups, return_inverse=True)[1].ravel(), weights=difference)
    slack = 1e-9 * np.abs(sums).sum()  # sums in another order are equal
    if 2 ** len(sums) <= FLIPS:
        signs = np.array(list(product((-1.0, 1.0), repeat=len(sums))))
        return float((np.abs(signs @ sums) >= abs(sums.sum()) - slack).mean())
    signs = rng.choice([-1.0, 1.0], size=(FLIPS, len(sums)))
    return float((1 + (np.abs(signs @ sums) >= abs(sums.sum()) - slack).sum()) / (1 + FLIPS))


def holm(ps: list[float]) -> list[float]:
    """p values corrected for their number (Holm 1979), in the order given."""
    corrected, largest = [0.0] * len(ps), 0.0
    for rank, place in enumerate(np.argsort(ps, kind="stable")):
        largest = max(largest, min(1.0, (len(ps) - rank) * ps[place]))
        corrected[place] = largest
    return corrected
