"""Estimators whose fitted state is plain arrays: scikit-learn may fit them; they answer, and load, without it."""

from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np

MOST_POINTS = 4000  # that a kernel or a ridge is fitted to: its matrix has their square
FLOOR = 0.01  # added to the probabilities of several members, so that no member's zero is a veto
TINY = np.finfo(np.float32).tiny


class Arrays:
    """Base of what is fitted: its arrays are kept in a file, contiguous, so that answers are equal to the last digit.

    Letters in their descriptions: F is the length of a point, K the number of classes fitted to, S of live sensors.
    """

    def state_dict(self) -> dict[str, np.ndarray]:
        """All arrays that were fitted."""
        return {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}

    def load_state_dict(self, state: Mapping[str, np.ndarray]) -> Self:
        """Take over the arrays that `state_dict` gave."""
        vars(self).update(state)
        return self


class Estimator(Arrays):
    """Base of the estimators.

    Attributes:
        classes: (K,) the distinct labels that it was fitted to, rising.
    """

    classes: np.ndarray

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        """Fit to points (n, F) and labels (n,)."""
        raise NotImplementedError

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """Probabilities (n, K)."""
        raise NotImplementedError


def sampled(
    points: np.ndarray, labels: np.ndarray, seed: int, most: int = MOST_POINTS
) -> tuple[np.ndarray, np.ndarray]:
    """The points (n, F) and labels (n,); of more than `most` as many at random, and the first of each class."""
    if len(points) <= most:
        return points, labels
    index = np.random.default_rng(seed).permutation(len(points))[:most]
    index = np.union1d(index, np.unique(labels, return_index=True)[1])
    return points[index], labels[index]


def probabilities(estimator: Estimator, points: np.ndarray, classes: int) -> np.ndarray:
    """Probabilities float32 (n, classes); 0 for a class that the estimator was not fitted to."""
    shares = np.zeros((len(points), classes), dtype=np.float32)
    if len(points):
        shares[:, estimator.classes] = estimator.predict_proba(points)
    return shares


def added(shares: Sequence[np.ndarray]) -> np.ndarray:
    """Logits (B, classes) from the probabilities of one member or several: the sum of their logarithms."""
    if len(shares) == 1:
        return np.log(np.maximum(shares[0], TINY))
    return np.log(np.stack(shares) + FLOOR).sum(axis=0)
