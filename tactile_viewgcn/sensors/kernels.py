"""Kernel ridge regression as a classifier of what the sensors read, and of means over blocks of sensors."""

from typing import Any

import numpy as np
from scipy.special import softmax
from sklearn.base import BaseEstimator, ClassifierMixin, TransformerMixin

BLOCKS = (2, 4, 8)  # rows and columns
LIVE_SHARE = 0.5  # of a block's cells, at least
WIDTH, RIDGE, SHARPNESS = 2.0, 0.3, 8.0
MAX_POINTS = 4000  # beyond it the kernel's matrix is approximated
LANDMARKS = 2000  # of the approximation


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


class KernelClassifier(ClassifierMixin, BaseEstimator):
    """Ridge regression of the classes' indicators with the kernel exp(-2 d^2 / m), m the mean squared distance.

    Probabilities are the softmax of eight times the regression's values.
    """

    def fit(self, points: np.ndarray, labels: np.ndarray) -> "KernelClassifier":
        self.classes_ = np.unique(labels)
        spread = float(points.var(axis=0).sum())  # half of the mean squared distance
        gamma = WIDTH / (2 * spread) if spread else 1.0
        indicators = (labels[:, None] == self.classes_).astype(np.float32)
        self.regression_ = ridge_regression(len(points), gamma).fit(points, indicators)
        return self

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        return softmax(SHARPNESS * self.regression_.predict(points), axis=1)


def ridge_regression(points: int, gamma: float) -> Any:
    """Ridge regression with the kernel exp(-gamma d^2), on landmarks alone where there are many training points."""
    from sklearn.kernel_approximation import Nystroem
    from sklearn.kernel_ridge import KernelRidge
    from sklearn.linear_model import Ridge
    from sklearn.pipeline import make_pipeline

    if points <= MAX_POINTS:
        return KernelRidge(alpha=RIDGE, kernel="rbf", gamma=gamma)
    features = Nystroem(kernel="rbf", gamma=gamma, n_components=LANDMARKS, random_state=0)
    return make_pipeline(features, Ridge(alpha=RIDGE, fit_intercept=False))
