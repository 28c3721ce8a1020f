"""Estimators whose fitted state is plain arrays: scikit-learn may fit them; they answer, and load, without it."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Self, get_type_hints

import numpy as np

MOST_POINTS = 4000  # that a kernel or a ridge is fitted to: its matrix has their square
FLOOR = 0.01  # added to the probabilities of several members, so that no member's zero is a veto
TINY = np.finfo(np.float32).tiny


class Arrays:
    """Base of what is fitted and kept as arrays: attributes of the form `Annotated[np.ndarray, type]`.

    Letters in their descriptions: F is the length of a point, K the number of classes fitted to, S of live sensors.
    """

    @classmethod
    def types(cls) -> dict[str, type]:
        """The type of each kept array, by its name."""
        hints = get_type_hints(cls, include_extras=True)
        return {name: hint.__metadata__[0] for name, hint in hints.items() if hasattr(hint, "__metadata__")}

    def take(self, **arrays: Any) -> Self:
        """Set the kept arrays, contiguous: so answers are equal to the last digit after a file has kept them.

        Raises:
            KeyError: one is missing.
        """
        for name, dtype in self.types().items():
            setattr(self, name, np.asarray(arrays[name], dtype=dtype, order="C"))
        return self

    def state_dict(self) -> dict[str, np.ndarray]:
        """The kept arrays, which `take` sets again."""
        return {name: getattr(self, name) for name in self.types()}


class Estimator(Arrays):
    """Base of the estimators.

    Attributes:
        classes: (K,) the distinct labels that it was fitted to, rising.
    """

    classes: Annotated[np.ndarray, np.int64]

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        """Fit to points (n, F) and labels (n,)."""
        raise NotImplementedError

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """Probabilities (n, K)."""
        raise NotImplementedError


def sampled(points: np.ndarray, labels: np.ndarray, seed: int, most: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """The points (n, F) and labels (n,); of more than `most` (4,000) as many at random, and the first of each class."""
    most = most or MOST_POINTS
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


def state_of(estimators: Mapping[str, Estimator]) -> dict[str, dict[str, np.ndarray]]:
    """The kept arrays of estimators, by name."""
    return {name: each.state_dict() for name, each in estimators.items()}
