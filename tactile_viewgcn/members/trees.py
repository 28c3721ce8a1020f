"""The member `trees`: extremely randomised trees on statistics in the order of time."""

import warnings
from typing import Self

import numpy as np

from tactile_viewgcn.members import features
from tactile_viewgcn.members.estimators import Estimator
from tactile_viewgcn.members.of_readings import MemberOfReadings

TREES = 300
QUICK_TREES = 100
MOST_PATHS = 1 << 16  # most points times trees that are evaluated at once


class TreesMember(MemberOfReadings):
    """Answers only whole recordings, since its statistics of channels need the order of time."""

    name = "trees"

    def estimator(self, *, quick: bool = False) -> "Forest":
        """See `MemberOfReadings.estimator`."""
        if quick:
            return Forest(QUICK_TREES)
        return Forest(TREES)

    def recording_points(self, readings: np.ndarray) -> np.ndarray:
        """See `MemberOfReadings.recording_points`."""
        if self.representation.blocks is None:
            return features.in_time(readings.astype(np.float64))
        return features.finer_array_maps(readings, self.representation.blocks)


class Forest(Estimator):
    """Extremely randomised trees, grown by scikit-learn and evaluated all at once.

    Geurts, Ernst and Wehenkel, "Extremely randomized trees" (Machine Learning 63, 2006). The nodes
    of all trees are numbered in one sequence, and a parent comes before its children. A leaf is its
    own child.

    Args:
        trees: number of trees.

    Attributes:
        roots: (T,), the node at which each tree begins.
        left, right: (N,), the child of each node if the feature is at most the threshold, and the
            child if it is above.
        feature, threshold: (N,), the feature that each node looks at, and its threshold.
        leaf: (N,), the row in `shares` of each node that is a leaf.
        shares: (L, K), the share of each class in the training points of a leaf.
    """

    def __init__(self, trees: int = TREES):
        self._trees = trees

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        """See `Estimator.fit`."""
        from sklearn.ensemble import ExtraTreesClassifier

        # scikit-learn's threads empty each other's list of warning filters, and warn about it
        with warnings.catch_warnings(record=True):
            # whichever list a thread has, no filter in it turns that warning into an error
            warnings.resetwarnings()
            grown = ExtraTreesClassifier(self._trees, random_state=seed, n_jobs=-1)
            grown.fit(points, labels)
        trees = [estimator.tree_ for estimator in grown.estimators_]
        left = np.concatenate([tree.children_left for tree in trees])
        right = np.concatenate([tree.children_right for tree in trees])
        feature = np.concatenate([tree.feature for tree in trees])
        threshold = np.concatenate([tree.threshold for tree in trees])
        shares = np.concatenate([tree.value for tree in trees])
        sizes = np.array([tree.node_count for tree in trees])
        self.classes = grown.classes_
        self.roots = np.cumsum(sizes) - sizes
        root_of_node = np.repeat(self.roots, sizes)
        is_inner = left >= 0
        node = np.arange(len(left))
        self.left = np.where(is_inner, left + root_of_node, node)
        self.right = np.where(is_inner, right + root_of_node, node)
        self.feature = np.where(is_inner, feature, 0)
        self.threshold = np.where(is_inner, threshold, 0)
        self.leaf = np.cumsum(~is_inner) - 1
        self.shares = shares[~is_inner, 0].astype(np.float32)
        return self

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """See `Estimator.predict_proba`; the trees are evaluated in parts that fit memory."""
        points = np.ascontiguousarray(points, dtype=np.float32)
        total = np.zeros((len(points), len(self.classes)))
        parts = max(1, -(-len(self.roots) * len(points) // MOST_PATHS))
        for roots in np.array_split(self.roots, parts):
            leaves = self.leaf[self._ends(points, roots)]
            total += self.shares[leaves].sum(axis=0, dtype=np.float64)
        return total / len(self.roots)

    def _ends(self, points: np.ndarray, roots: np.ndarray) -> np.ndarray:
        """Return the leaves (t, n) that points (n, F) reach from roots (t,), all in parallel."""
        ends = np.repeat(roots, len(points))
        path = np.arange(len(ends))
        node = ends.copy()
        first_feature = path % len(points) * points.shape[1]  # place of the point's first feature
        values = points.ravel()
        while len(path):
            is_above = values[first_feature + self.feature[node]] > self.threshold[node]
            child = np.where(is_above, self.right[node], self.left[node])
            has_moved = child > node  # nodes only rise, so no altered file makes an endless loop
            ends[path] = child
            path = path[has_moved]
            node = child[has_moved]
            first_feature = first_feature[has_moved]
        return ends.reshape(len(roots), -1)
