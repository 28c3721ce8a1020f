"""What a user can get wrong: one line each, and nothing trained."""

from functools import cache

import numpy as np
import pytest
from scipy import sparse
from sklearn.exceptions import NotFittedError

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.errors import UserError

CHOSEN = {"preprocess.baseline": "none", "preprocess.zero": 0, "preprocess.filter": "none"}


def recordings(count: int = 4) -> list[np.ndarray]:
    """Recordings (5, 4, 4) of counts above baseline."""
    return list(np.random.default_rng(0).integers(0, 50, (count, 5, 4, 4), dtype=np.int16))


def with_third(recording) -> list:
    return [*recordings(2), recording, *recordings(1)]


def changed(value: float, dtype: type = float) -> np.ndarray:
    counts = np.ones((5, 4, 4), dtype)
    counts[1, 2, 3] = value
    return counts


Y = ["a", "a", "b", "b"]

#: what is given to `fit` besides the classifier's own arguments, and what the line has to say
IN_FIT = {
    "no recordings": ({"X": [], "y": []}, "X holds no recordings"),
    "a text": ({"X": "data/recordings"}, "X is of type str with 0 axes; expected a list of"),
    "nothing": ({"X": None}, "X is of type NoneType with 0 axes; expected"),
    "one recording, not in a list": ({"X": recordings()[0]}, "with 3 axes.* one recording is \\[recording\\]"),
    "a ragged frame": ({"X": with_third([[[1, 2], [3]]])}, "ragged"),
    "an axis too few": ({"X": with_third(np.ones((4, 4)))}, r"X\[2\] has shape \(4, 4\); expected \(frames, rows"),
    "another layout": (
        {"X": with_third(np.ones((5, 4, 3)))},
        r"X\[2\] has frames of 4 x 3; expected 4 x 4, as X\[0\]",
    ),
    "no frames": ({"X": with_third(np.ones((0, 4, 4)))}, r"X\[2\] has shape \(0, 4, 4\)"),
    "too many rows": ({"X": [np.ones((2, 65, 4))] * 4}, r"X\[0\]: frames of 65 x 4; expected 1 x 1 to 64 x 64"),
    "NaN": ({"X": with_third(changed(np.nan))}, r"X\[2\] holds nan in frame 1, row 2, column 3"),
    "NaN in rows": ({"X": [[1, np.nan], [2, 3], [4, 5], [6, 7]]}, "NaN"),
    "counts too large": ({"X": with_third(changed(2**40, np.int64))}, r"X\[2\] holds counts from 1 to 1099511627776"),
    "texts": ({"X": with_third(np.full((5, 4, 4), "1"))}, r"X\[2\] is of type <U1"),
    "sparse": ({"X": sparse.csr_array(np.eye(4))}, "[Ss]parse"),
    "no sensor varies": ({"X": [np.ones((5, 4, 4))] * 4}, "no sensor varies"),
    "labels of another length": ({"y": ["a", "b"]}, r"inconsistent numbers of samples: \[4, 2\]"),
    "one class": ({"y": ["a"] * 4}, "y has one class, a; expected two or more"),
    "labels of two columns": ({"y": [["a", "b"]] * 4}, "y should be a 1d array"),
    "real numbers as labels": ({"y": [0.1, 0.2, 0.3, 0.4]}, "Unknown label type: continuous"),
    "a missing label": ({"y": ["a", "a", "b", None]}, "y holds labels of different kinds"),
    "groups of another length": ({"groups": [0, 1, 2]}, r"groups has shape \(3,\); expected \(4,\)"),
    "no such preset": ({"preset": "bset"}, "preset is 'bset'; did you mean best"),
    "no such system": ({"system": "mvccn"}, "model.system: .*'mvcnn'.*got 'mvccn'"),
    "no views": ({"views": 0}, r"views: .*\(got 0\)"),
    "no such key": ({"params": {"preprocess.scal": 2}}, "preprocess.scal"),
    "a value YAML has not": ({"params": {"preprocess.scale": object()}}, "preprocess.scale: <object"),
    "params as a text": ({"params": "views=4"}, "params is 'views=4'; expected a mapping"),
    "a negative seed": ({"random_state": -1}, r"seed: .*\(got -1\)"),
    "a system that needs all views": ({"preset": "best", "system": "stag"}, "which needs all views"),
    "view sets with a baseline": (
        {"X": np.ones((4, 2, 3, 3)), "params": {"preprocess.baseline": "grasp"}},
        "preprocess.baseline is grasp, and X holds view sets",
    ),
    "no empty hand": ({"params": {"preprocess.baseline": "empty_hand"}}, "'empty_hand'"),
}


@pytest.mark.parametrize("mistake, line", IN_FIT.values(), ids=IN_FIT)
def test_a_mistake_in_fit_ends_in_one_line(mistake, line):
    arguments = {key: mistake[key] for key in ("preset", "system", "views", "random_state") if key in mistake}
    params = mistake.get("params", {})
    classifier = TactileClassifier(**arguments, params=CHOSEN | params if isinstance(params, dict) else params)
    with pytest.raises((ValueError, TypeError), match=line) as error:
        classifier.fit(mistake.get("X", recordings()), mistake.get("y", Y), groups=mistake.get("groups"))
    assert len(str(error.value).splitlines()) == 1 or error.type is not UserError  # scikit-learn's own may have more
    assert not hasattr(classifier, "recogniser_")


@cache
def fitted(form: str) -> TactileClassifier:
    X = {"recordings": recordings(), "view sets": np.stack(recordings()), "rows": np.arange(16).reshape(4, 4)}[form]
    return TactileClassifier(system="logistic", params=CHOSEN).fit(X, Y)


IN_PREDICT = {
    "another layout": ("recordings", [np.ones((5, 4, 3))], r"X\[0\]: frames of 4 x 3; expected 4 x 4"),
    "no recordings": ("recordings", [], "X holds no recordings"),
    "view sets for recordings": ("recordings", np.ones((2, 5, 4, 4)), "X holds view sets; expected recordings"),
    "recordings for view sets": ("view sets", recordings(), "X holds recordings; expected view sets"),
    "too many views": ("view sets", np.ones((2, 6, 4, 4), int), r"counts has shape \(2, 6, 4, 4\)"),
    "rows of other sensors": ("rows", np.ones((2, 3)), "X has 3 features, but TactileClassifier is expecting 4"),
}


@pytest.mark.parametrize("form, X, line", IN_PREDICT.values(), ids=IN_PREDICT)
def test_a_mistake_in_predict_ends_in_one_line(form, X, line):
    with pytest.raises(ValueError, match=line) as error:
        fitted(form).predict(X)
    assert len(str(error.value).splitlines()) == 1


def test_nothing_is_predicted_or_saved_before_fit(tmp_path):
    for call in (lambda new: new.predict(recordings()), lambda new: new.save(tmp_path / "classifier.pt")):
        with pytest.raises(NotFittedError):
            call(TactileClassifier())
    assert not list(tmp_path.iterdir())


def test_a_fit_that_fails_leaves_the_trained_classifier_as_it_was():
    classifier = TactileClassifier(system="logistic", params=CHOSEN).fit(recordings(), Y)
    before = classifier.predict_proba(recordings())
    with pytest.raises(ValueError, match="no sensor varies"):
        classifier.fit([np.ones((5, 4, 4))] * 4, ["c", "c", "d", "d"])
    assert classifier.classes_.tolist() == ["a", "b"]
    assert (classifier.predict_proba(recordings()) == before).all()
