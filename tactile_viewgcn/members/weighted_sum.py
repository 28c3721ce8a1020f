"""The weighted sum of the members' log-probabilities."""

from collections.abc import Sequence

import numpy as np

FLOOR = 0.01  # added to the probabilities of several members, so that no member can veto a class
TINY = np.finfo(np.float32).tiny


def log_probabilities(probabilities: Sequence[np.ndarray]) -> np.ndarray:
    """Return the logarithms (M, n, classes) of M members' probabilities, after adding `FLOOR`."""
    logarithms: np.ndarray = np.log(np.stack(probabilities) + FLOOR)
    return logarithms


def weighted_sum(probabilities: Sequence[np.ndarray], weights: Sequence[float]) -> np.ndarray:
    """Return logits (n, classes): the weighted sum of the members' log-probabilities.

    The logits of a single member are its log-probabilities, whatever its weight.

    Args:
        probabilities: (n, classes), the probabilities of each member.
        weights: the weight of each member.
    """
    if len(probabilities) == 1:
        only: np.ndarray = np.log(np.maximum(probabilities[0], TINY))
        return only
    logarithms = log_probabilities(probabilities)
    logits: np.ndarray = np.tensordot(np.array(weights, dtype=np.float32), logarithms, 1)
    return logits
