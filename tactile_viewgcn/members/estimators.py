"""Estimators whose fitted state is plain arrays: scikit-learn may fit them; they answer, and load, without it."""

import warnings
from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np

TREES, FEWEST_TREES = 300, 100  # of a fit, and of a quick one
MOST_PATHS = 1 << 16  # points times trees that are evaluated at once
MOST_POINTS = 4000  # that a kernel or a ridge is fitted to: its matrix has their square
FLOOR = 0.01  # added to the probabilities of several members, so that no member's zero is a veto
TINY = np.finfo(np.float32).tiny


class Arrays:
    """Base of what is fitted: its arrays are kept in a file, contiguous, so that answers are equal to the last digit.

    Letters in their descriptions: F is the length of a point, K the number of classes fitted to, S
    of live sensors.
    """

    def state_dict(self) -> dict[str, np.ndarray]:
        """All arrays that were fitted."""
        return {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}

    def load_state_dict(self, state: Mapping[str, np.ndarray]) -> Self:
        """Take over the arrays that `state_dict` gave."""
        vars(self).update(state)
        return self


class Estimator(Arrays):
    """Base of the estimators.

    Attributes:
        classes: (K,) the distinct labels that it was fitted to, rising.
    """

    classes: np.ndarray

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        """Fit to points (n, F) and labels (n,)."""
        raise NotImplementedError

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """Probabilities (n, K)."""
        raise NotImplementedError


class Forest(Estimator):
    """Extremely randomised trees (Geurts et al. 2006), grown by scikit-learn and evaluated all at
    once. The nodes of all trees are numbered in one sequence, a parent before its children. A leaf
    is its own child.

    Attributes:
        roots: (T,) node at which each tree begins.
        left, right: (N,) child of each node for a feature up to the threshold, and above it.
        feature, threshold: (N,) of each node.
        leaf: (N,) row of `shares` of each node that is a leaf.
        shares: (L, K) share of each class in the training points of a leaf.
    """

    def __init__(self, trees: int = TREES):
        self._trees = trees

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        from sklearn.ensemble import ExtraTreesClassifier

        # its threads empty each other's list of filters, and warn of it
        with warnings.catch_warnings(record=True):
            warnings.resetwarnings()  # no filter makes that an error, whichever list a thread has
            grown = ExtraTreesClassifier(self._trees, random_state=seed, n_jobs=-1).fit(
                points, labels
            )
        left, right, feature, threshold, shares = (
            np.concatenate([getattr(each.tree_, name) for each in grown.estimators_])
            for name in ("children_left", "children_right", "feature", "threshold", "value")
        )
        sizes = np.array([each.tree_.node_count for each in grown.estimators_])
        self.classes, self.roots = grown.classes_, np.cumsum(sizes) - sizes
        inner, node, start = left >= 0, np.arange(len(left)), np.repeat(self.roots, sizes)
        self.left, self.right = (
            np.where(inner, left + start, node),
            np.where(inner, right + start, node),
        )
        self.feature, self.threshold = np.where(inner, feature, 0), np.where(inner, threshold, 0)
        self.leaf, self.shares = np.cumsum(~inner) - 1, shares[~inner, 0].astype(np.float32)
        return self

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        points, total = (
            np.ascontiguousarray(points, dtype=np.float32),
            np.zeros((len(points), len(self.classes))),
        )
        for roots in np.array_split(
            self.roots, max(1, -(-len(self.roots) * len(points) // MOST_PATHS))
        ):
            total += self.shares[self.leaf[self._ends(points, roots)]].sum(axis=0, dtype=np.float64)
        return total / len(self.roots)

    def _ends(self, points: np.ndarray, roots: np.ndarray) -> np.ndarray:
        """The leaves (t, n) that points (n, F) reach from the roots (t,) of trees; all points walk down at once."""
        ends = np.repeat(roots, len(points))
        path, node = np.arange(len(ends)), ends
        first = path % len(points) * points.shape[1]  # place of the point's first feature
        while len(path):
            above = points.ravel()[first + self.feature[node]] > self.threshold[node]
            child = np.where(above, self.right[node], self.left[node])
            ends[path], moved = child, child > node  # so that no altered file makes a circle
            path, node, first = path[moved], child[moved], first[moved]
        return ends.reshape(len(roots), -1)


def sampled(
    points: np.ndarray, labels: np.ndarray, seed: int, most: int = MOST_POINTS
) -> tuple[np.ndarray, np.ndarray]:
    """The points (n, F) and labels (n,); of more than `most` as many at random, and the first of each class."""
    if len(points) <= most:
        return points, labels
    index = np.random.default_rng(seed).permutation(len(points))[:most]
    index = np.union1d(index, np.unique(labels, return_index=True)[1])
    return points[index], labels[index]


def probabilities(estimator: Estimator, points: np.ndarray, classes: int) -> np.ndarray:
    """Probabilities float32 (n, classes); 0 for a class that the estimator was not fitted to."""
    shares = np.zeros((len(points), classes), dtype=np.float32)
    shares[:, estimator.classes] = estimator.predict_proba(points)
    return shares


def log_shares(shares: Sequence[np.ndarray]) -> np.ndarray:
    """Logarithms (M, B, classes) of the probabilities of several members, each a little above 0."""
    return np.log(np.stack(shares) + FLOOR)


def added(shares: Sequence[np.ndarray], weights: Sequence[float]) -> np.ndarray:
    """Logits (B, classes) from the probabilities of one member or several: the weighted sum of their logarithms."""
    if len(shares) == 1:
        return np.log(np.maximum(shares[0], TINY))
    return np.tensordot(np.array(weights, dtype=np.float32), log_shares(shares), 1)
