"""Kernel ridge regression as a classifier of what the sensors read, and of means over blocks of sensors."""

import numpy as np
from scipy.linalg import solve
from scipy.special import softmax
from sklearn.base import BaseEstimator, ClassifierMixin, TransformerMixin

from tactile_viewgcn.sensors.gaussian import GaussianKernel, some_points

BLOCKS = (2, 4, 8)  # rows and columns
LIVE_SHARE = 0.5  # of a block's cells, at least
WIDTH, RIDGE, SHARPNESS = 2.0, 0.3, 8.0


class BlockMeans(TransformerMixin, BaseEstimator):
    """Readings (n, S) of live sensors (H, W) to these and their means over square blocks, (n, S + blocks).

    Blocks distinguish neighbouring sensors from distant ones.
    """

    def __init__(self, live: np.ndarray):
        self.live = live

    def fit(self, points: np.ndarray, labels: np.ndarray | None = None) -> "BlockMeans":
        self.weights_ = block_weights(self.live)
        return self

    def transform(self, points: np.ndarray) -> np.ndarray:
        return np.concatenate([points, points @ self.weights_], axis=1)


def block_weights(live: np.ndarray) -> np.ndarray:
    """float32 (S, blocks): a column has equal weights, of sum 1, on the live sensors (H, W) of one block."""
    rows, columns = np.nonzero(live)
    weights = []
    for size in BLOCKS:
        number = rows // size * live.shape[1] + columns // size
        members = number[:, None] == np.unique(number)
        weights.append((members / members.sum(axis=0))[:, members.sum(axis=0) >= LIVE_SHARE * size**2])
    return np.concatenate(weights, axis=1).astype(np.float32)


class KernelClassifier(GaussianKernel, ClassifierMixin, BaseEstimator):
    """Ridge regression of the classes' indicators with the kernel exp(-2 d^2 / m), m the mean squared distance.

    Probabilities are the softmax of eight times the regression's values.

    Args:
        seed: of the choice of points, where there are more than 4,000.
    """

    def __init__(self, seed: int = 0):
        self.seed = seed

    def fit(self, points: np.ndarray, labels: np.ndarray) -> "KernelClassifier":
        points, labels = some_points(points, labels, self.seed)
        self.classes_ = np.unique(labels)
        spread = float(points.var(axis=0).sum())  # half of the mean squared distance
        self.keep(points, WIDTH / (2 * spread) if spread else 1.0)
        kernel = self.kernel(points)
        kernel[np.diag_indices(len(points))] += RIDGE
        indicators = (labels[:, None] == self.classes_).astype(np.float32)
        self.weights_ = solve(kernel, indicators, assume_a="pos", overwrite_a=True, check_finite=False)
        return self

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        return softmax(SHARPNESS * (self.kernel(points) @ self.weights_), axis=1)
