"""Estimators whose fitted state is plain arrays, so that they load and answer without scikit-learn.

Only some of the fits use scikit-learn.
"""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Self

import numpy as np

# most points that a kernel or a ridge regression is fitted to: its matrix has the square of that
MOST_POINTS = 4000


class Arrays:
    """Base of everything that is fitted: its arrays are its state.

    The arrays are contiguous, so that a loaded state gives the same answers to the last digit.

    The shapes of subclasses have these letters: F is the length of a point, K is the number of
    classes in the fit, and S is the number of live sensors.
    """

    def state_dict(self) -> dict[str, np.ndarray]:
        """Return all arrays that were fitted."""
        return {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}

    def load_state_dict(self, state: Mapping[str, np.ndarray]) -> Self:
        """Restore the arrays that `state_dict` returned, and return the object itself."""
        vars(self).update(state)
        return self


class Estimator(Arrays):
    """Base of the estimators of points.

    Attributes:
        classes: (K,), the distinct labels of the fit, rising.
    """

    classes: np.ndarray

    @abstractmethod
    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        """Fit to points (n, F) and labels (n,).

        Args:
            points: (n, F).
            labels: (n,) classes.
            seed: seed of random choices.
        """

    @abstractmethod
    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """Return the probabilities (n, K) of points (n, F)."""


def sampled(
    points: np.ndarray, labels: np.ndarray, seed: int, most: int = MOST_POINTS
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and labels, or a random sample of them if there are too many.

    The sample always has the first point of each class.

    Args:
        points: (n, F).
        labels: (n,) classes.
        seed: seed of the sample.
        most: number of points above which a sample is drawn.
    """
    if len(points) <= most:
        return points, labels
    sample = np.random.default_rng(seed).permutation(len(points))[:most]
    first_of_class = np.unique(labels, return_index=True)[1]
    index = np.union1d(sample, first_of_class)
    return points[index], labels[index]


def probabilities(estimator: Estimator, points: np.ndarray, classes: int) -> np.ndarray:
    """Return probabilities float32 (n, classes), with 0 for each class that was not in the fit.

    Args:
        estimator: a fitted estimator.
        points: (n, F).
        classes: number of all classes.
    """
    of_all_classes = np.zeros((len(points), classes), dtype=np.float32)
    of_all_classes[:, estimator.classes] = estimator.predict_proba(points)
    return of_all_classes
