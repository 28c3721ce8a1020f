"""Kernel ridge regression as a classifier of what the sensors read, and of means over blocks of sensors."""

from typing import Annotated, Self

import numpy as np
from scipy.linalg import solve
from scipy.special import softmax

from tactile_viewgcn.sensors.estimators import Estimator, TrainingFrames

MOST_POINTS = 4000  # that a classifier is fitted to: the kernel is a matrix of their square
BLOCKS = (2, 4, 8)  # rows and columns
LIVE_SHARE = 0.5  # of a block's cells, at least
WIDTH, RIDGE, SHARPNESS = 2.0, 0.3, 8.0


class Kernel(Estimator):
    """The Gaussian kernel exp(-gamma d^2) between points and those that it was fitted to, in single precision.

    Attributes:
        points: (M, P) about their mean, in a unit in which gamma is a half; half_squares: (M,) of their lengths.
        centre: (P,) their mean; scale: what they are multiplied by.
    """

    scale: Annotated[np.ndarray, np.float32, ""]
    centre: Annotated[np.ndarray, np.float32, "P"]
    points: Annotated[np.ndarray, np.float32, "MP"]
    half_squares: Annotated[np.ndarray, np.float32, "M"]

    def centred(self, points: np.ndarray, gamma: float) -> Self:
        """Take the points (M, P) that others are compared with."""
        self.scale = np.array((2 * gamma) ** 0.5, dtype=np.float32)
        self.centre = points.mean(axis=0, dtype=np.float64).astype(np.float32)
        self.points = self._scaled(points)
        self.half_squares = (self.points**2).sum(axis=1) / 2
        return self

    def kernel(self, points: np.ndarray) -> np.ndarray:
        """Kernel float32 (n, M) of points (n, P)."""
        points = self._scaled(points)
        exponent = points @ self.points.T
        exponent -= (points**2).sum(axis=1)[:, None] / 2
        exponent -= self.half_squares
        return np.exp(np.minimum(exponent, 0, out=exponent), out=exponent)

    def _scaled(self, points: np.ndarray) -> np.ndarray:
        return (np.asarray(points, dtype=np.float32) - self.centre) * self.scale


class KernelRidge(Kernel):
    """Ridge regression of the classes' indicators with the kernel exp(-2 d^2 / m), m the mean squared distance.

    To readings (n, F) of live sensors means over square blocks of them are added, which distinguish neighbouring
    sensors from distant ones. Probabilities are the softmax of eight times the regression's values.
    """

    blocks: Annotated[np.ndarray, np.float32, "FB"]
    weights: Annotated[np.ndarray, np.float32, "MK"]

    def fit(self, points: np.ndarray, labels: np.ndarray, data: TrainingFrames) -> Self:
        blocks = block_weights(data.live)
        points, labels = some_points(np.concatenate([points, points @ blocks], axis=1), labels, data.seed)
        spread = float(points.var(axis=0).sum())  # half of the mean squared distance
        kernel = self.centred(points, WIDTH / (2 * spread) if spread else 1.0).kernel(points)
        kernel[np.diag_indices(len(points))] += RIDGE
        classes = np.unique(labels)
        indicators = (labels[:, None] == classes).astype(np.float32)
        weights = solve(kernel, indicators, assume_a="pos", overwrite_a=True, check_finite=False)
        return self.take(**vars(self), classes=classes, blocks=blocks, weights=weights)

    def check(self, features: int) -> None:
        if len(self.centre) != features + self.blocks.shape[1]:
            raise ValueError("a kernel has points of other sensors than its blocks")

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        points = np.concatenate([points, points @ self.blocks], axis=1)
        return softmax(SHARPNESS * (self.kernel(points) @ self.weights), axis=1)


def block_weights(live: np.ndarray) -> np.ndarray:
    """float32 (S, blocks): a column has equal weights, of sum 1, on the live sensors (H, W) of one block."""
    rows, columns = np.nonzero(live)
    weights = []
    for size in BLOCKS:
        number = rows // size * live.shape[1] + columns // size
        members = number[:, None] == np.unique(number)
        weights.append((members / members.sum(axis=0))[:, members.sum(axis=0) >= LIVE_SHARE * size**2])
    return np.concatenate(weights, axis=1).astype(np.float32)


def some_points(points: np.ndarray, labels: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """At most 4,000 of the points (n, F) and their labels (n,), drawn at random; of each class one at least."""
    if len(points) <= MOST_POINTS:
        return points, labels
    index = np.random.default_rng(seed).permutation(len(points))[:MOST_POINTS]
    index = np.union1d(index, np.unique(labels, return_index=True)[1])
    return points[index], labels[index]
