"""Kernel ridge regression and support vector machines, both with a Gaussian kernel, whose state is plain arrays."""

import warnings
from typing import Self

import numpy as np
from scipy.linalg import solve
from scipy.special import softmax

from tactile_viewgcn.members.estimators import MOST_POINTS, Estimator, sampled

WIDTH, RIDGE, SHARPNESS = 2.0, 0.3, 8.0  # of kernel ridge regression
C = 10.0  # of the support vector machines
# of a standardised feature's spread within classes; of a feature's size
LEAST_WITHIN, ROUNDING = 0.05, 1e-9


class Kernel(Estimator):
    """The Gaussian kernel exp(-gamma d^2) between points and the points that it was fitted to, in single precision.

    Attributes:
        centre: (F,) mean of the fitted points.
        scale: factor that turns gamma into a half.
        points: (M, F) fitted points, less `centre`, times `scale`.
        half_squares: (M,) half of their squared lengths.
    """

    def centred(self, points: np.ndarray, gamma: float) -> Self:
        """Set the points (M, F) that others are compared with."""
        self.scale = np.array((2 * gamma) ** 0.5, dtype=np.float32)
        self.centre = points.mean(axis=0, dtype=np.float64).astype(np.float32)
        self.points = self._scaled(points)
        self.half_squares = (self.points**2).sum(axis=1) / 2
        return self

    def kernel(self, points: np.ndarray) -> np.ndarray:
        """Kernel float32 (n, M) of points (n, F)."""
        points = self._scaled(points)
        exponent = points @ self.points.T
        exponent -= (points**2).sum(axis=1)[:, None] / 2
        exponent -= self.half_squares
        return np.exp(np.minimum(exponent, 0, out=exponent), out=exponent)

    def _scaled(self, points: np.ndarray) -> np.ndarray:
        return (np.asarray(points, dtype=np.float32) - self.centre) * self.scale


class KernelRidge(Kernel):
    """Ridge regression of the classes' indicators with the kernel exp(-2 d^2 / m), m the mean squared distance.

    Probabilities are the softmax of eight times the regression's values.

    Args:
        most: points that it is fitted to.

    Attributes:
        weights: (M, K) of the kernel's values.
    """

    def __init__(self, most: int = MOST_POINTS):
        self._most = most

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        points, labels = sampled(points, labels, seed, self._most)
        spread = float(points.var(axis=0).sum())  # half of the mean squared distance
        kernel = self.centred(points, WIDTH / (2 * spread) if spread else 1.0).kernel(points)
        kernel[np.diag_indices(len(points))] += RIDGE
        self.classes = np.unique(labels)
        indicators = (labels[:, None] == self.classes).astype(np.float32)
        weights = solve(kernel, indicators, assume_a="pos", overwrite_a=True, check_finite=False)
        self.weights = np.ascontiguousarray(weights)
        return self

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        return softmax(SHARPNESS * (self.kernel(points) @ self.weights), axis=1)


class SupportVectors(Kernel):
    """One machine for each pair of classes (scikit-learn's SVC, C = 10), with the kernel exp(-d^2 / (F v)).

    v is the variance of all values of the points (n, F). Probabilities are the softmax of the
    classes' votes.

    Attributes:
        class_of: (M,) index into `classes` of each support vector.
        weights: (M, K - 1) of each support vector against each other class.
        offsets: (K (K - 1) / 2,) of the pairs of classes: (0, 1), (0, 2) and so on.
    """

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        from sklearn.svm import SVC

        points, labels = sampled(points, labels, seed)
        spread = float(points.var()) * points.shape[1]
        kernel = self.centred(points, 1 / spread if spread else 1.0).kernel(points)
        # of many objects of two recordings each
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            machines = SVC(C=C, kernel="precomputed", cache_size=500).fit(kernel, labels)
        self.classes = machines.classes_
        self.class_of = np.repeat(np.arange(len(self.classes)), machines.n_support_)
        self.points, self.half_squares = (
            self.points[machines.support_],
            self.half_squares[machines.support_],
        )
        self.weights = machines.dual_coef_.T.astype(np.float32, order="C")
        self.offsets = machines.intercept_.astype(np.float32)
        return self

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """See `Estimator`; all pairs of classes are compared at once."""
        kernel, classes = self.kernel(points), len(self.classes)
        # of a margin, by a class against another
        parts = np.zeros((classes, len(points), classes), dtype=np.float32)
        for number in range(classes):
            members = np.flatnonzero(self.class_of == number)
            others = np.delete(np.arange(classes), number)
            parts[number][:, others] = kernel[:, members] @ self.weights[members]
        first, second = np.triu_indices(classes, 1)
        # above 0: the first class
        margin = parts[first, :, second] + parts[second, :, first] + self.offsets[:, None]
        margin = margin if classes > 2 else -margin  # as SVC stores the weights of two classes
        votes, confidence = np.zeros((2, classes, len(points)), dtype=np.float32)
        for side, winner in ((margin, first), (-margin, second)):
            np.add.at(votes, winner, (side > 0).astype(np.float32))
            np.add.at(confidence, winner, side)
        # below a third: it only decides between equal votes
        votes += confidence / (3 * (np.abs(confidence) + 1))
        return softmax(votes.T, axis=1)


class NormalisedVectors(SupportVectors):
    """Support vector machines on points whose features are of unlike kind.

    Each feature is standardised, squashed by sign(z) log(1 + |z|), and divided by its spread within
    classes, so that those weigh most that repeat in recordings of one object.

    Attributes:
        mean, spread: (F,) over all points; within: (F,) spread within classes, after squashing.
    """

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        points, labels = sampled(points, labels, seed)
        self.mean, self.spread, self.within = (
            points.mean(axis=0),
            points.std(axis=0),
            np.ones(points.shape[1]),
        )
        self.spread[~(self.spread > ROUNDING * np.abs(points).max(axis=0))] = 1
        squashed, classes = self._normalised(points), np.unique(labels)
        parts = [squashed[labels == label] for label in classes]
        squares = np.sum([part.var(axis=0) * len(part) for part in parts], axis=0)
        self.within = np.maximum(
            np.sqrt(squares / max(len(points) - len(classes), 1)), LEAST_WITHIN
        )
        return super().fit(self._normalised(points), labels, seed)

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        return super().predict_proba(self._normalised(points))

    def _normalised(self, points: np.ndarray) -> np.ndarray:
        standard = (points - self.mean) / self.spread
        return np.copysign(np.log1p(np.abs(standard)), standard) / self.within
