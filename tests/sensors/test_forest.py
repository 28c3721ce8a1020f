"""Trees as arrays: the same answers as scikit-learn's, and no index is followed that leads outside."""

from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.ensemble import ExtraTreesClassifier

from tactile_viewgcn.sensors import forest
from tactile_viewgcn.sensors.forest import Forest

RNG = np.random.default_rng(0)
POINTS, LABELS = RNG.normal(size=(60, 7)).astype(np.float32), np.arange(60) % 3
DATA = SimpleNamespace(frames=POINTS, classes=3, quick=True, seed=0)


def state() -> dict:
    return Forest().fit(POINTS, LABELS, DATA).state_dict()


@pytest.mark.parametrize("paths", [1 << 16, 300])  # all trees at once, a few at a time
def test_its_answers_are_scikit_learn_s_and_outlive_a_file(monkeypatch, paths):
    monkeypatch.setattr(forest, "MOST_PATHS", paths)
    expected = ExtraTreesClassifier(100, random_state=0).fit(POINTS, LABELS).predict_proba(POINTS + 0.1)
    again = Forest().load_state_dict(state(), 7, 3)
    for copy in (Forest().fit(POINTS, LABELS, DATA), again):
        np.testing.assert_allclose(copy.predict_proba(POINTS + 0.1), expected, rtol=1e-6)
    assert again.predict_proba(POINTS[:0]).shape == (0, 3)


def put(name: str, value: int, *, inner: bool = True):
    """A different value in the first inner node, or the first leaf."""

    def change(state: dict) -> None:
        is_inner = state["left"].numpy() != np.arange(len(state["left"]))
        state[name][int((is_inner == inner).argmax())] = value

    return change


def replaced(name: str, change):
    return lambda state: state.update({name: change(state[name])})


#: what is wrong with the arrays of trees
ALTERED = {
    "a loop": replaced("right", lambda right: right.clamp(max=1)),
    "outside the trees": put("right", 10**9),
    "below 0": put("left", -1),
    "half a leaf": put("right", 0),
    "a leaf with a child": put("right", 3, inner=False),
    "a feature outside": put("feature", 7),
    "a feature below 0": put("feature", -2),
    "a root outside": put("roots", 10**9),
    "fewer nodes": replaced("threshold", lambda threshold: threshold[:-1]),
    "children as real numbers": replaced("left", lambda left: left.double()),
    "leaves without shares": replaced("shares", lambda shares: shares[:-1]),
    "leaves of fewer classes": replaced("shares", lambda shares: shares[:, :2]),
    "a class that there is not": replaced("classes", lambda classes: classes + 1),
    "an array missing": lambda state: state.pop("roots"),
}


@pytest.mark.parametrize("change", ALTERED.values(), ids=ALTERED)
def test_altered_trees_are_refused_before_they_are_followed(change):
    arrays = state()
    change(arrays)
    with pytest.raises(ValueError):
        Forest().load_state_dict(arrays, 7, 3)
