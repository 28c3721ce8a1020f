"""The Gaussian kernel exp(-gamma d^2) between points, in single precision."""

import numpy as np

MOST_POINTS = 4000  # that a classifier is fitted to: the kernel is a matrix of their square


class GaussianKernel:
    """The kernel with the points (m, F) that a classifier is fitted to, kept about their mean as plain arrays."""

    def keep(self, points: np.ndarray, gamma: float) -> None:
        """Take the points (m, F) that others are compared with."""
        self.scale_, self.centre_ = float((2 * gamma) ** 0.5), points.mean(axis=0, dtype=np.float64).astype(np.float32)
        self.points_ = self._scaled(points)
        self.half_squares_ = (self.points_**2).sum(axis=1) / 2

    def kernel(self, points: np.ndarray) -> np.ndarray:
        """Kernel float32 (n, m) between points (n, F) and those that were kept."""
        points = self._scaled(points)
        exponent = points @ self.points_.T
        exponent -= (points**2).sum(axis=1)[:, None] / 2
        exponent -= self.half_squares_
        return np.exp(np.minimum(exponent, 0, out=exponent), out=exponent)

    def _scaled(self, points: np.ndarray) -> np.ndarray:
        """Points about the mean, in a unit in which gamma is a half."""
        return (np.asarray(points, dtype=np.float32) - self.centre_) * np.float32(self.scale_)


def some_points(points: np.ndarray, labels: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """At most 4,000 of the points (n, F) and their labels (n,), drawn at random; of each class one at least."""
    if len(points) <= MOST_POINTS:
        return points, labels
    index = np.random.default_rng(seed).permutation(len(points))[:MOST_POINTS]
    index = np.union1d(index, np.unique(labels, return_index=True)[1])
    return points[index], labels[index]
