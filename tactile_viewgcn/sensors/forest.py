"""Extremely randomised trees (Geurts et al. 2006), grown by scikit-learn and evaluated in plain arrays.

For a few points scikit-learn's own trees are slow, because 300 of them are called one by one.
"""

import warnings
from typing import Self

import numpy as np

from tactile_viewgcn.sensors.estimators import Estimator

TREES, FEWEST_TREES = 300, 100
MOST_LEAF_VALUES = 60_000_000  # class probabilities in the leaves: 0.25 GB
MOST_PATHS = 1 << 16  # points times trees that are evaluated at once


class Forest(Estimator):
    """Fully grown trees: as few as 100 where the leaves of more would hold more than 60 million numbers.

    The nodes of all trees are numbered in one sequence, a parent before its children. A leaf is its own child.

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

        fitting = MOST_LEAF_VALUES // (len(points) * len(np.unique(labels)))
        count = int(np.clip(fitting, FEWEST_TREES, self._trees))
        with warnings.catch_warnings(record=True):  # its threads warn of each other's change to the list of filters
            grown = ExtraTreesClassifier(count, random_state=seed, n_jobs=-1).fit(points, labels)
        trees = [each.tree_ for each in grown.estimators_]
        left, right, feature, threshold, shares = (
            np.concatenate([getattr(tree, name) for tree in trees])
            for name in ("children_left", "children_right", "feature", "threshold", "value")
        )
        sizes = np.array([tree.node_count for tree in trees])
        self.classes, self.roots = grown.classes_, np.cumsum(sizes) - sizes
        inner, node, start = left >= 0, np.arange(len(left)), np.repeat(self.roots, sizes)
        self.left, self.right = np.where(inner, left + start, node), np.where(inner, right + start, node)
        self.feature, self.threshold = np.where(inner, feature, 0), np.where(inner, threshold, 0)
        self.leaf, self.shares = np.cumsum(~inner) - 1, shares[~inner, 0].astype(np.float32)
        return self

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        points, total = np.ascontiguousarray(points, dtype=np.float32), np.zeros((len(points), len(self.classes)))
        for roots in np.array_split(self.roots, max(1, -(-len(self.roots) * len(points) // MOST_PATHS))):
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
            ends[path], moved = child, child != node
            path, node, first = path[moved], child[moved], first[moved]
        return ends.reshape(len(roots), -1)
