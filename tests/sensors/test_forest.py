"""Trees as arrays: the same answers as scikit-learn's, and no index is followed that leads outside."""

import pickle

import numpy as np
import pytest
from sklearn.ensemble import ExtraTreesClassifier

from tactile_viewgcn.sensors.forest import LEAF, Forest

RNG = np.random.default_rng(0)
POINTS, LABELS = RNG.normal(size=(60, 7)).astype(np.float32), np.arange(60) % 3


def forest() -> Forest:
    return Forest(5, random_state=0).fit(POINTS, LABELS)


def test_its_answers_are_scikit_learn_s_and_outlive_its_state():
    expected = ExtraTreesClassifier(5, random_state=0).fit(POINTS, LABELS).predict_proba(POINTS + 0.1)
    again = Forest.__new__(Forest)
    again.__setstate__(forest().__getstate__())
    for copy in (forest(), again, pickle.loads(pickle.dumps(again))):
        assert (copy.predict_proba(POINTS + 0.1) == expected).all()
    assert Forest(5, random_state=0).__getstate__()["n_estimators"] == 5  # before it is fitted


def put(name: str, value: float, inner: bool = True):
    """Another value in the first inner node, or the first leaf."""

    def change(state: dict) -> None:
        node = int(((state["left_child"] == LEAF) != inner).argmax())
        state[name][node] = value

    return change


def replaced(name: str, change):
    return lambda state: state.update({name: change(state[name])})


#: what is wrong with the arrays of trees, and the line
ALTERED = {
    "its own parent": (put("left_child", 0), "a child that is not below it"),
    "a loop": (replaced("right_child", lambda right: np.where(right > 0, 1, right)), "a child that is not below it"),
    "outside the tree": (put("right_child", 10**9), "a child that is not below it"),
    "half a leaf": (put("right_child", LEAF), "a child that is not below it"),
    "a feature outside": (put("feature", 10**9), "a feature that there is not"),
    "a feature below 0": (put("feature", -2), "a feature that there is not"),
    "features that are none": (replaced("features", str), "a feature that there is not"),
    "fewer nodes": (replaced("threshold", lambda threshold: threshold[:-1]), "other sizes than its nodes"),
    "more nodes": (replaced("node_counts", lambda counts: counts + 1), "other sizes than its nodes"),
    "a tree without nodes": (replaced("node_counts", lambda counts: np.append(counts, 0)), "no whole numbers"),
    "children as real numbers": (replaced("left_child", lambda left: left.astype(float)), "no whole numbers"),
    "leaves without values": (replaced("leaf_values", lambda values: values[:-1]), "other values than its classes"),
    "leaves of fewer classes": (replaced("leaf_values", lambda values: values[:, :2]), "other values than its classes"),
}


@pytest.mark.parametrize("change, line", ALTERED.values(), ids=ALTERED)
def test_altered_trees_are_refused_before_they_are_built(change, line):
    state = forest().__getstate__()
    change(state)
    with pytest.raises(ValueError, match=line):
        Forest.__new__(Forest).__setstate__(state)
