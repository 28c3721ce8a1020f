"""Extremely randomised trees (Geurts et al. 2006), grown by scikit-learn and followed in plain arrays.

scikit-learn's own trees follow whatever a file says: a child that is its own parent never ends, one outside the tree
reads foreign memory. For a few points it also takes most of its time to call 500 trees one by one.
"""

import warnings
from typing import Annotated, Any, Self

import numpy as np

from tactile_viewgcn.sensors.estimators import Estimator, TrainingFrames

TREES, FEWEST_TREES = 500, 100
MOST_LEAF_VALUES = 60_000_000  # probabilities of classes in leaves: 0.25 GB
MOST_PATHS = 1 << 16  # points times trees at once


class Forest(Estimator):
    """Fully grown trees: 500, or as few as 100 where their leaves would hold more than 60 million numbers.

    The nodes of all trees stand in one row, a parent before its children. A leaf is its own child.

    Attributes:
        roots: (T,) node at which each tree begins.
        left, right: (N,) child where the feature is at most the threshold, and where it is above.
        shares: (L, K) of the training points' classes in each leaf, in the order of nodes.
    """

    roots: Annotated[np.ndarray, np.int64, "T"]
    left: Annotated[np.ndarray, np.int64, "N"]
    right: Annotated[np.ndarray, np.int64, "N"]
    feature: Annotated[np.ndarray, np.int64, "N"]
    threshold: Annotated[np.ndarray, np.float64, "N"]
    shares: Annotated[np.ndarray, np.float32, "LK"]

    def fit(self, points: np.ndarray, labels: np.ndarray, data: TrainingFrames) -> Self:
        from sklearn.ensemble import ExtraTreesClassifier

        fitting = MOST_LEAF_VALUES // (len(data.frames) * data.classes)
        count = FEWEST_TREES if data.quick else int(np.clip(fitting, FEWEST_TREES, TREES))
        with warnings.catch_warnings(record=True):  # its threads change one list of filters, and then warn of that
            grown = ExtraTreesClassifier(count, random_state=data.seed, n_jobs=-1).fit(points, labels)
        trees = [each.tree_ for each in grown.estimators_]
        sizes = np.array([tree.node_count for tree in trees])
        roots, node = np.cumsum(sizes) - sizes, np.arange(sizes.sum())
        start = np.repeat(roots, sizes)
        left, right = (
            np.concatenate([getattr(tree, f"children_{side}") for tree in trees]) for side in ("left", "right")
        )
        inner = left >= 0
        return self.take(
            classes=grown.classes_,
            roots=roots,
            left=np.where(inner, left + start, node),
            right=np.where(inner, right + start, node),
            feature=np.where(inner, np.concatenate([tree.feature for tree in trees]), 0),
            threshold=np.where(inner, np.concatenate([tree.threshold for tree in trees]), 0),
            shares=np.concatenate([tree.value[:, 0] for tree in trees])[~inner],
        )

    def take(self, **arrays: Any) -> Self:
        super().take(**arrays)
        self._leaf = np.cumsum(self.left == np.arange(len(self.left))) - 1  # row of shares
        return self

    def check(self, features: int) -> None:
        node = np.arange(len(self.left))
        for child in (self.left, self.right):
            if not ((node <= child) & (child < len(node))).all():
                raise ValueError("a tree's node has a child that is not below it")
        if not len(self.roots) or not ((self.roots >= 0) & (self.roots < len(node))).all():
            raise ValueError("a tree begins outside its nodes")
        if not ((self.feature >= 0) & (self.feature < features)).all():
            raise ValueError("a tree's node asks for a feature that there is not")
        leaf = self.left == node
        if len(self.shares) != leaf.sum() or (leaf != (self.right == node)).any():
            raise ValueError("a tree's leaves have other shares than their nodes")

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        points, total = np.ascontiguousarray(points, dtype=np.float32), np.zeros((len(points), len(self.classes)))
        for roots in np.array_split(self.roots, max(1, -(-len(self.roots) * len(points) // MOST_PATHS))):
            total += self.shares[self._leaf[self._ends(points, roots)]].sum(axis=0, dtype=np.float64)
        return total / len(self.roots)

    def _ends(self, points: np.ndarray, roots: np.ndarray) -> np.ndarray:
        """The leaves (t, n) in which points (n, F) end that begin at the roots (t,) of trees; all walk down at once."""
        ends = np.repeat(roots, len(points))
        path, node = np.arange(len(ends)), ends
        first = path % len(points) * points.shape[1]  # of the point's features
        while len(path):
            above = points.ravel()[first + self.feature[node]] > self.threshold[node]
            child = np.where(above, self.right[node], self.left[node])
            ends[path], moved = child, child != node
            path, node, first = path[moved], child[moved], first[moved]
        return ends.reshape(len(roots), -1)
