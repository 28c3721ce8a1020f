"""A support vector machine with a Gaussian kernel, whose state is plain arrays that are only multiplied."""

from typing import Annotated, Self

import numpy as np
from scipy.special import softmax

from tactile_viewgcn.sensors.estimators import TrainingFrames
from tactile_viewgcn.sensors.kernels import Kernel, some_points

C = 10.0
MOST_VALUES = 1 << 24  # numbers of pairs of classes at once


class SupportVectors(Kernel):
    """One machine for each pair of classes (scikit-learn's SVC, C = 10), with the kernel exp(-d^2 / (F v)).

    v is the variance of all values of the points (n, F). Probabilities are the softmax of the classes' votes.

    Attributes:
        class_of: (M,) number of each support vector's class; weights: (M, K - 1) against each other class.
        offsets: (K (K - 1) / 2,) of pairs of classes, in order.
    """

    class_of: Annotated[np.ndarray, np.int64, "M"]
    weights: Annotated[np.ndarray, np.float32, "MO"]
    offsets: Annotated[np.ndarray, np.float32, "Q"]

    def fit(self, points: np.ndarray, labels: np.ndarray, data: TrainingFrames) -> Self:
        from sklearn.svm import SVC

        points, labels = some_points(points, labels, data.seed)
        spread = float(points.var()) * points.shape[1]
        kernel = self.centred(points, 1 / spread if spread else 1.0).kernel(points)
        machines = SVC(C=C, kernel="precomputed", cache_size=500).fit(kernel, labels)
        return self.take(
            classes=machines.classes_,
            scale=self.scale,
            centre=self.centre,
            points=self.points[machines.support_],
            half_squares=self.half_squares[machines.support_],
            class_of=np.repeat(np.arange(len(machines.classes_)), machines.n_support_),
            weights=machines.dual_coef_.T,
            offsets=machines.intercept_,
        )

    def check(self, features: int) -> None:
        others = len(self.classes) - 1
        sizes = len(self.centre), self.weights.shape[1], len(self.offsets)
        if sizes != (features, others, (others + 1) * others // 2):
            raise ValueError("support vectors of other sensors or classes than theirs")

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        parts = -(-len(points) * len(self.classes) ** 2 // MOST_VALUES)
        return np.concatenate([self._probabilities(part) for part in np.array_split(points, max(1, parts))])

    def _probabilities(self, points: np.ndarray) -> np.ndarray:
        """The same of few points: all pairs of classes are compared at once."""
        kernel, classes = self.kernel(points), len(self.classes)
        parts = np.zeros((classes, len(points), classes), dtype=np.float32)  # of a class' vectors, against each other
        for number in range(classes):
            members = np.flatnonzero(self.class_of == number)
            others = np.delete(np.arange(classes), number)
            parts[number][:, others] = kernel[:, members] @ self.weights[members]
        first, second = np.triu_indices(classes, 1)
        margin = parts[first, :, second] + parts[second, :, first] + self.offsets[:, None]  # above 0: the first class
        margin = margin if classes > 2 else -margin  # SVC's own sign
        votes, confidence = np.zeros((2, classes, len(points)), dtype=np.float32)
        for side, winner in ((margin, first), (-margin, second)):
            np.add.at(votes, winner, (side > 0).astype(np.float32))
            np.add.at(confidence, winner, side)
        votes += confidence / (3 * (np.abs(confidence) + 1))  # less than a third: it decides between equal votes
        return softmax(votes.T, axis=1)
