"""Extremely randomised trees whose state is plain arrays, checked before a tree follows an index in them.

scikit-learn's own state of 500 trees is 2,500 arrays, which skops reads in seconds, and its trees follow whatever a
file says: a child that is its own parent never ends, one outside the tree reads foreign memory.
"""

from typing import Any

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.tree import ExtraTreeClassifier
from sklearn.tree._tree import NODE_DTYPE, Tree

LEAF = -1  # in place of a child
ARRAYS = ("left_child", "right_child", "feature", "threshold")


class Forest(ExtraTreesClassifier):
    """ExtraTreesClassifier; what is kept of it is what `predict_proba` needs."""

    def fit(self, X: np.ndarray, y: np.ndarray, sample_weight: np.ndarray | None = None) -> "Forest":
        """Grow the trees on all cores; later one core answers, which takes less time for a few points."""
        self.set_params(n_jobs=-1)
        super().fit(X, y, sample_weight)
        self.set_params(n_jobs=None)
        return self

    def __getstate__(self) -> dict[str, Any]:
        if not hasattr(self, "estimators_"):
            return super().__getstate__()
        trees = [tree.tree_ for tree in self.estimators_]
        nodes = np.concatenate([tree.__getstate__()["nodes"] for tree in trees])
        state = {name: np.ascontiguousarray(nodes[name]) for name in ARRAYS}
        leaf = state["left_child"] == LEAF
        return state | {
            "classes": self.classes_,
            "features": self.n_features_in_,
            "node_counts": np.array([tree.node_count for tree in trees]),
            "leaf_values": np.concatenate([tree.value[:, 0] for tree in trees])[leaf],
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        if "node_counts" not in state:
            super().__setstate__(state)
            return
        super().__init__(len(state["node_counts"]))
        self.classes_, self.n_features_in_ = state["classes"], state["features"]
        self.n_classes_, self.n_outputs_ = len(self.classes_), 1
        check_trees(state)
        ends = np.cumsum(state["node_counts"])
        leaves = np.cumsum(state["left_child"] == LEAF)
        self.estimators_ = []
        for end, count in zip(ends, state["node_counts"], strict=True):
            nodes, values = np.zeros(count, NODE_DTYPE), np.zeros((count, 1, self.n_classes_))
            for name in ARRAYS:
                nodes[name] = state[name][end - count : end]
            leaf = nodes["left_child"] == LEAF
            values[leaf, 0] = state["leaf_values"][leaves[end - 1] - leaf.sum() : leaves[end - 1]]
            tree = ExtraTreeClassifier()
            tree.n_features_in_, tree.n_outputs_ = self.n_features_in_, 1
            tree.classes_, tree.n_classes_ = self.classes_, self.n_classes_
            tree.tree_ = Tree(self.n_features_in_, np.array([self.n_classes_]), 1)
            tree.tree_.__setstate__({"max_depth": 0, "node_count": count, "nodes": nodes, "values": values})
            self.estimators_.append(tree)


def check_trees(state: dict[str, Any]) -> None:
    """Raise a ValueError unless every path in the trees ends in a leaf, and every index lies inside its array.

    Args:
        state: `node_counts` (T,); of all trees' n nodes `left_child`, `right_child`, `feature`, `threshold` (n,);
            `leaf_values` (leaves, classes); `features`; `classes`.
    """
    counts, left, right = (np.asarray(state[name]) for name in ("node_counts", "left_child", "right_child"))
    arrays = [np.asarray(state[name]) for name in ARRAYS]
    if counts.ndim != 1 or any(array.dtype.kind != "i" for array in (counts, *arrays[:3])) or not (counts > 0).all():
        raise ValueError("a tree's nodes are no whole numbers")
    if any(array.shape != (counts.sum(),) for array in arrays) or arrays[3].dtype != np.float64:
        raise ValueError("a tree's arrays have other sizes than its nodes")
    inner = left != LEAF
    if state["leaf_values"].shape != ((~inner).sum(), len(state["classes"])):
        raise ValueError("a tree's leaves have other values than its classes")
    node = np.concatenate([np.arange(count) for count in counts])
    size = np.repeat(counts, counts)
    for child in (left, right):
        if not ((node < child) & (child < size))[inner].all():
            raise ValueError("a tree's node has a child that is not below it")
    feature = arrays[2][inner]
    if not isinstance(state["features"], int) or not ((feature >= 0) & (feature < state["features"])).all():
        raise ValueError("a tree's node asks for a feature that there is not")
