"""The member `svm`: support vector machines on statistics over a recording's frames."""

import warnings
from typing import Self

import numpy as np
from scipy.special import softmax

from tactile_viewgcn.members import features
from tactile_viewgcn.members.estimators import sampled
from tactile_viewgcn.members.kernels import Kernel
from tactile_viewgcn.members.of_readings import MemberOfSets

C = 10.0
LEAST_WITHIN = 0.05  # least spread within classes of a standardised feature
ROUNDING = 1e-9  # a spread below this share of a feature's size is rounding


class SvmMember(MemberOfSets):
    """Turns a recording or a view set into one point; an array is read in the finer unit."""

    name = "svm"

    def estimator(self, *, quick: bool = False) -> "SupportVectors":
        """See `MemberOfReadings.estimator`."""
        if self.representation.is_array:
            return SupportVectors()
        return NormalisedVectors()

    def recording_points(self, readings: np.ndarray) -> np.ndarray:
        """See `MemberOfReadings.recording_points`."""
        if self.representation.blocks is None:
            return features.in_windows(readings.astype(np.float64))
        return features.finer_array_maps(readings, self.representation.blocks)

    def set_points(self, readings: np.ndarray) -> np.ndarray:
        """See `MemberOfSets.set_points`."""
        if self.representation.blocks is None:
            return features.unordered(readings.astype(np.float64))
        return features.finer_array_maps(readings, self.representation.blocks)


class SupportVectors(Kernel):
    """One machine for each pair of classes (scikit-learn's SVC, C = 10) with a Gaussian kernel.

    The kernel is exp(-d^2 / (F v)), where v is the variance of all values of the points (n, F). The
    probabilities are the softmax of the classes' votes.

    Attributes:
        class_of: (M,), the index in `classes` of each support vector.
        weights: (M, K - 1), the weights of each support vector against each other class.
        offsets: (K (K - 1) / 2,), the offsets of the pairs of classes (0, 1), (0, 2) and so on.
    """

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        """See `Estimator.fit`."""
        from sklearn.svm import SVC

        points, labels = sampled(points, labels, seed)
        spread = float(points.var()) * points.shape[1]
        gamma = 1.0
        if spread != 0:
            gamma = 1 / spread
        kernel = self.centred(points, gamma).kernel(points)
        # scikit-learn warns if many objects have two recordings each
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            machines = SVC(C=C, kernel="precomputed", cache_size=500).fit(kernel, labels)
        self.classes = machines.classes_
        self.class_of = np.repeat(np.arange(len(self.classes)), machines.n_support_)
        self.points = self.points[machines.support_]
        self.half_squares = self.half_squares[machines.support_]
        self.weights = machines.dual_coef_.T.astype(np.float32, order="C")
        self.offsets = machines.intercept_.astype(np.float32)
        return self

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """See `Estimator.predict_proba`; all pairs of classes are compared at once."""
        classes = len(self.classes)
        first, second = np.triu_indices(classes, 1)
        margin = self._margins(self.kernel(points), first, second)
        votes = np.zeros((classes, len(points)), dtype=np.float32)
        confidence = np.zeros((classes, len(points)), dtype=np.float32)
        for margin_of_winner, winner in ((margin, first), (-margin, second)):
            np.add.at(votes, winner, (margin_of_winner > 0).astype(np.float32))
            np.add.at(confidence, winner, margin_of_winner)
        # the confidence adds less than a third, so it only decides between equal votes
        votes += confidence / (3 * (np.abs(confidence) + 1))
        answers: np.ndarray = softmax(votes.T, axis=1)
        return answers

    def _margins(self, kernel: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Return the margins (pairs, n) of each pair of classes; above 0, the first class wins.

        Args:
            kernel: (n, M), the kernel of the points and the support vectors.
            first: (pairs,), the first class of each pair.
            second: (pairs,), the second class of each pair.
        """
        classes = len(self.classes)
        # the part of each margin that comes from the support vectors of one class of the pair
        parts = np.zeros((classes, len(kernel), classes), dtype=np.float32)
        for label in range(classes):
            vectors = np.flatnonzero(self.class_of == label)
            others = np.delete(np.arange(classes), label)
            parts[label][:, others] = kernel[:, vectors] @ self.weights[vectors]
        margin: np.ndarray = parts[first, :, second] + parts[second, :, first]
        margin = margin + self.offsets[:, None]
        if classes > 2:
            return margin
        return -margin  # SVC stores the weights of two classes the other way round


class NormalisedVectors(SupportVectors):
    """Support vector machines on points whose features are of different kinds.

    Each feature is standardised, squashed by sign(z) log(1 + |z|), and divided by its spread within
    classes. So features that hardly vary between recordings of one object have the largest weight.

    Attributes:
        mean, spread: (F,), over all points.
        within: (F,), the spread within classes, after squashing.
    """

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        """See `Estimator.fit`."""
        points, labels = sampled(points, labels, seed)
        self.mean = points.mean(axis=0)
        self.spread = points.std(axis=0)
        is_constant = ~(self.spread > ROUNDING * np.abs(points).max(axis=0))
        self.spread[is_constant] = 1
        self.within = np.ones(points.shape[1])
        squashed = self._normalised(points)
        classes = np.unique(labels)
        squares = []
        for label in classes:
            of_class = squashed[labels == label]
            squares.append(of_class.var(axis=0) * len(of_class))
        degrees_of_freedom = max(len(points) - len(classes), 1)
        within = np.sqrt(np.sum(squares, axis=0) / degrees_of_freedom)
        self.within = np.maximum(within, LEAST_WITHIN)
        return super().fit(self._normalised(points), labels, seed)

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """See `Estimator.predict_proba`."""
        return super().predict_proba(self._normalised(points))

    def _normalised(self, points: np.ndarray) -> np.ndarray:
        standard = (points - self.mean) / self.spread
        squashed: np.ndarray = np.copysign(np.log1p(np.abs(standard)), standard)
        return squashed / self.within
