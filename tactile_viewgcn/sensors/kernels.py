"""Kernel ridge regression and support vector machines, both with a Gaussian kernel, whose state is plain arrays."""

from typing import Annotated, Self

import numpy as np
from scipy.linalg import solve
from scipy.special import softmax

from tactile_viewgcn.sensors.estimators import Estimator, TrainingFrames

MOST_POINTS = 4000  # that an estimator is fitted to: a kernel matrix has their square
BLOCKS = (2, 4, 8)  # rows and columns of a block
LIVE_SHARE = 0.5  # of a block's cells that are live, at least
WIDTH, RIDGE, SHARPNESS = 2.0, 0.3, 8.0  # of kernel ridge regression
C = 10.0  # of the support vector machines
MOST_VALUES = 1 << 24  # margins between two classes that are computed at once


class Kernel(Estimator):
    """The Gaussian kernel exp(-gamma d^2) between points and the points that it was fitted to, in single precision.

    Attributes:
        centre: (P,) mean of the fitted points.
        scale: factor that turns gamma into a half.
        points: (M, P) fitted points, less `centre`, times `scale`.
        half_squares: (M,) half of their squared lengths.
    """

    scale: Annotated[np.ndarray, np.float32, ""]
    centre: Annotated[np.ndarray, np.float32, "P"]
    points: Annotated[np.ndarray, np.float32, "MP"]
    half_squares: Annotated[np.ndarray, np.float32, "M"]

    def centred(self, points: np.ndarray, gamma: float) -> Self:
        """Set the points (M, P) that others are compared with."""
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

    Means over square blocks of sensors are added to the readings (n, F) of the live sensors, so that neighbouring
    sensors count as more alike than distant ones. Probabilities are the softmax of eight times the regression's values.

    Attributes:
        blocks: (F, B), see `block_weights`; weights: (M, K) of the kernel's values.
    """

    blocks: Annotated[np.ndarray, np.float32, "FB"]
    weights: Annotated[np.ndarray, np.float32, "MK"]

    def fit(self, points: np.ndarray, labels: np.ndarray, data: TrainingFrames) -> Self:
        blocks = block_weights(data.live)
        points, labels = sampled(np.concatenate([points, points @ blocks], axis=1), labels, data.seed)
        spread = float(points.var(axis=0).sum())  # half of the mean squared distance
        kernel = self.centred(points, WIDTH / (2 * spread) if spread else 1.0).kernel(points)
        kernel[np.diag_indices(len(points))] += RIDGE
        classes = np.unique(labels)
        indicators = (labels[:, None] == classes).astype(np.float32)
        weights = solve(kernel, indicators, assume_a="pos", overwrite_a=True, check_finite=False)
        return self.take(**vars(self), classes=classes, blocks=blocks, weights=weights)

    def check(self, features: int) -> None:
        if len(self.centre) != features + self.blocks.shape[1]:
            raise ValueError("a kernel has points and blocks of different sensors")

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        points = np.concatenate([points, points @ self.blocks], axis=1)
        return softmax(SHARPNESS * (self.kernel(points) @ self.weights), axis=1)


class SupportVectors(Kernel):
    """One machine for each pair of classes (scikit-learn's SVC, C = 10), with the kernel exp(-d^2 / (F v)).

    v is the variance of all values of the points (n, F). Probabilities are the softmax of the classes' votes.

    Attributes:
        class_of: (M,) index into `classes` of each support vector.
        weights: (M, K - 1) of each support vector against each other class.
        offsets: (K (K - 1) / 2,) of the pairs of classes: (0, 1), (0, 2) and so on.
    """

    class_of: Annotated[np.ndarray, np.int64, "M", "K"]
    weights: Annotated[np.ndarray, np.float32, "MO"]
    offsets: Annotated[np.ndarray, np.float32, "Q"]

    def fit(self, points: np.ndarray, labels: np.ndarray, data: TrainingFrames) -> Self:
        from sklearn.svm import SVC

        points, labels = sampled(points, labels, data.seed)
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
            raise ValueError("support vectors are of different sensors or classes")

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        count = max(1, -(-len(points) * len(self.classes) ** 2 // MOST_VALUES))  # parts that fit memory
        return np.concatenate([self._probabilities(part) for part in np.array_split(points, count)])

    def _probabilities(self, points: np.ndarray) -> np.ndarray:
        """Probabilities (n, K) of few points: all pairs of classes are compared at once."""
        kernel, classes = self.kernel(points), len(self.classes)
        parts = np.zeros((classes, len(points), classes), dtype=np.float32)  # of a margin, by a class against another
        for number in range(classes):
            members = np.flatnonzero(self.class_of == number)
            others = np.delete(np.arange(classes), number)
            parts[number][:, others] = kernel[:, members] @ self.weights[members]
        first, second = np.triu_indices(classes, 1)
        margin = parts[first, :, second] + parts[second, :, first] + self.offsets[:, None]  # above 0: the first class
        margin = margin if classes > 2 else -margin  # as SVC stores the weights of two classes
        votes, confidence = np.zeros((2, classes, len(points)), dtype=np.float32)
        for side, winner in ((margin, first), (-margin, second)):
            np.add.at(votes, winner, (side > 0).astype(np.float32))
            np.add.at(confidence, winner, side)
        votes += confidence / (3 * (np.abs(confidence) + 1))  # below a third: it only decides between equal votes
        return softmax(votes.T, axis=1)


def block_weights(live: np.ndarray) -> np.ndarray:
    """float32 (S, B): a column has equal weights, of sum 1, on the live sensors, bool (H, W), of one block."""
    rows, columns = np.nonzero(live)
    weights = []
    for size in BLOCKS:
        number = rows // size * live.shape[1] + columns // size
        members = number[:, None] == np.unique(number)
        weights.append((members / members.sum(axis=0))[:, members.sum(axis=0) >= LIVE_SHARE * size**2])
    return np.concatenate(weights, axis=1).astype(np.float32)


def sampled(points: np.ndarray, labels: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The points (n, F) and labels (n,); of more than 4,000 a random 4,000 of them, and the first of each class."""
    if len(points) <= MOST_POINTS:
        return points, labels
    index = np.random.default_rng(seed).permutation(len(points))[:MOST_POINTS]
    index = np.union1d(index, np.unique(labels, return_index=True)[1])
    return points[index], labels[index]
