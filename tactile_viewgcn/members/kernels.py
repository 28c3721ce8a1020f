"""The Gaussian kernel between points, and kernel ridge regression with it, on plain arrays."""

from typing import Self

import numpy as np
from scipy.linalg import solve
from scipy.special import softmax

from tactile_viewgcn.members.estimators import MOST_POINTS, Estimator, sampled

WIDTH = 2.0  # factor in the kernel's exponent, -WIDTH d^2 / m with the mean squared distance m
RIDGE = 0.3  # added to the kernel's diagonal
KERNEL_SHARPNESS = 8.0  # factor before the softmax of the regression's values


class Kernel(Estimator):
    """The Gaussian kernel exp(-gamma d^2) to the fitted points, in single precision.

    Attributes:
        centre: (F,) mean of the fitted points.
        scale: factor on the points that turns gamma into a half.
        points: (M, F) fitted points, minus `centre`, times `scale`.
        half_squares: (M,) half of the squared lengths of `points`.
    """

    def centred(self, points: np.ndarray, gamma: float) -> Self:
        """Set the points (M, F) that the kernel compares others with; return the object itself."""
        self.scale = np.array((2 * gamma) ** 0.5, dtype=np.float32)
        self.centre = points.mean(axis=0, dtype=np.float64).astype(np.float32)
        self.points = self._scaled(points)
        self.half_squares = (self.points**2).sum(axis=1) / 2
        return self

    def kernel(self, points: np.ndarray) -> np.ndarray:
        """Return the kernel float32 (n, M) of points (n, F)."""
        points = self._scaled(points)
        exponent = points @ self.points.T
        exponent -= (points**2).sum(axis=1)[:, None] / 2
        exponent -= self.half_squares
        np.minimum(exponent, 0, out=exponent)
        kernel: np.ndarray = np.exp(exponent, out=exponent)
        return kernel

    def _scaled(self, points: np.ndarray) -> np.ndarray:
        scaled: np.ndarray = (np.asarray(points, dtype=np.float32) - self.centre) * self.scale
        return scaled


class KernelRidge(Kernel):
    """Ridge regression of the classes' indicators with a Gaussian kernel.

    The kernel is exp(-2 d^2 / m), where m is the mean squared distance of the points. The
    probabilities are the softmax of eight times the regression's values.

    Args:
        most: largest number of points of the fit.

    Attributes:
        weights: (M, K), the weights of the kernel's values.
    """

    def __init__(self, most: int = MOST_POINTS):
        self._most = most

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        """See `Estimator.fit`."""
        points, labels = sampled(points, labels, seed, self._most)
        half_mean_squared_distance = float(points.var(axis=0).sum())
        gamma = 1.0
        if half_mean_squared_distance != 0:
            gamma = WIDTH / (2 * half_mean_squared_distance)
        kernel = self.centred(points, gamma).kernel(points)
        kernel[np.diag_indices(len(points))] += RIDGE
        self.classes = np.unique(labels)
        indicators = (labels[:, None] == self.classes).astype(np.float32)
        weights = solve(kernel, indicators, assume_a="pos", overwrite_a=True, check_finite=False)
        self.weights = np.ascontiguousarray(weights)
        return self

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """See `Estimator.predict_proba`."""
        values = self.kernel(points) @ self.weights
        answers: np.ndarray = softmax(KERNEL_SHARPNESS * values, axis=1)
        return answers
