"""A support vector machine with a Gaussian kernel, whose state is plain arrays that are only multiplied."""

import numpy as np
from scipy.special import softmax
from sklearn.base import BaseEstimator, ClassifierMixin

from tactile_viewgcn.sensors.gaussian import GaussianKernel, some_points

C = 10.0
MOST_VALUES = 1 << 24  # numbers of pairs of classes at once


class SupportVectors(GaussianKernel, ClassifierMixin, BaseEstimator):
    """One machine for each pair of classes (scikit-learn's SVC, C = 10), with the kernel exp(-d^2 / (F v)).

    v is the variance of all values of the points (n, F). Probabilities are the softmax of the classes' votes.

    Args:
        seed: of the choice of points, where there are more than 4,000.
    """

    def __init__(self, seed: int = 0):
        self.seed = seed

    def fit(self, points: np.ndarray, labels: np.ndarray) -> "SupportVectors":
        from sklearn.svm import SVC

        points, labels = some_points(points, labels, self.seed)
        spread = float(points.var()) * points.shape[1]
        self.classes_ = np.unique(labels)
        self.keep(points, 1 / spread if spread else 1.0)
        machines = SVC(C=C, kernel="precomputed", cache_size=500).fit(self.kernel(points), labels)
        self.points_, self.half_squares_ = self.points_[machines.support_], self.half_squares_[machines.support_]
        self.class_of_ = np.repeat(np.arange(len(self.classes_)), machines.n_support_)
        self.weights_ = machines.dual_coef_.T.astype(np.float32)  # (m, classes - 1)
        self.offsets_ = machines.intercept_.astype(np.float32)  # of pairs of classes, in order
        return self

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """Probabilities (n, classes)."""
        parts = -(-len(points) * len(self.classes_) ** 2 // MOST_VALUES)
        return np.concatenate([self._probabilities(part) for part in np.array_split(points, max(1, parts))])

    def _probabilities(self, points: np.ndarray) -> np.ndarray:
        """The same of few points: all pairs of classes are compared at once."""
        kernel, classes = self.kernel(points), len(self.classes_)
        parts = np.zeros((classes, len(points), classes), dtype=np.float32)  # of a class' vectors, against each other
        for number in range(classes):
            members = np.flatnonzero(self.class_of_ == number)
            others = np.delete(np.arange(classes), number)
            parts[number][:, others] = kernel[:, members] @ self.weights_[members]
        first, second = np.triu_indices(classes, 1)
        margin = parts[first, :, second] + parts[second, :, first] + self.offsets_[:, None]  # above 0: the first class
        margin = margin if classes > 2 else -margin  # SVC's own sign
        votes, confidence = np.zeros((2, classes, len(points)), dtype=np.float32)
        for side, winner in ((margin, first), (-margin, second)):
            np.add.at(votes, winner, (side > 0).astype(np.float32))
            np.add.at(confidence, winner, side)
        votes += confidence / (3 * (np.abs(confidence) + 1))  # less than a third: it decides between equal votes
        return softmax(votes.T, axis=1)
