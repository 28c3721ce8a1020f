"""What a user of the estimator can get wrong: one line each that names it, and nothing trained."""

import numpy as np
import pytest
from sklearn.exceptions import NotFittedError

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.messages import UserError

pytestmark = pytest.mark.filterwarnings("ignore:answers to recordings")  # the labels are at random
CHOSEN = {"preprocess.baseline": "none", "preprocess.zero": 0, "preprocess.filter": "none"}
Y = ["a", "a", "b", "b"]


def recordings(count: int = 4) -> list[np.ndarray]:
    """Recordings (5, 4, 4) of counts above baseline."""
    return list(np.random.default_rng(0).integers(0, 50, (count, 5, 4, 4), dtype=np.int16))


def with_third(recording) -> list:
    return [*recordings(2), recording, *recordings(1)]


def changed(value: float, dtype: type = float) -> np.ndarray:
    counts = np.ones((5, 4, 4), dtype)
    counts[1, 2, 3] = value
    return counts


#: an argument of `fit` or of the classifier, its value, and what the line names
IN_FIT = {
    "no recordings": ("X", [], "list and holds no recordings"),
    "a text": ("X", "data/recordings", "str and holds no recordings"),
    "nothing": ("X", None, "NoneType and holds no recordings"),
    "one recording, not in a list": ("X", recordings()[0], r"\[5, 4\]"),
    "rows of sensors": ("X", np.ones((4, 9)), r"X\[0\].*\(9,\).*\(frames, rows, columns\)"),
    "a ragged frame": ("X", with_third([[[1, 2], [3]]]), r"X\[2\] is ragged"),
    "a different layout": ("X", [*recordings(1), *[np.ones((5, 4, 3))] * 3], r"X\[1\].*4 x 3.*4 x 4"),
    "an empty list of several": ("X", with_third([]), r"X\[2\].*\(0,\)"),
    "no frames": ("X", with_third(np.ones((0, 4, 4))), r"X\[2\] has no frames"),
    "NaN": ("X", with_third(changed(np.nan)), r"X\[2\] holds nan in frame 1, row 2, column 3"),
    "counts too large": ("X", with_third(changed(2**40, np.int64)), r"X\[2\].* 1 to 1099511627776"),
    "texts": ("X", with_third(np.full((5, 4, 4), "1")), r"X\[2\].*<U1"),
    "no sensor varies": ("X", [np.ones((5, 4, 4))] * 4, "no sensor varies"),
    "labels of a different length": ("y", ["a", "b"], r"\[4, 2\]"),
    "one class": ("y", ["a"] * 4, "y has one class, a"),
    "real numbers as labels": ("y", [0.1, 0.2, 0.3, 0.4], "continuous"),
    "a missing label": ("y", ["a", "a", "b", None], "y holds labels of different kinds"),
    "groups of a different length": ("groups", [0, 1, 2], r"groups.*\(3,\).*\(4,\)"),
    "no such system": ("system", "mvccn", "model.system: .*'mvccn'"),
    "a value YAML has not": ("params", {"preprocess.scale": object()}, "preprocess.scale: <object"),
    "params as a text": ("params", "views=4", "'views=4'"),
    "no empty hand": ("params", {"preprocess.baseline": "empty_hand"}, "'empty_hand'"),
}


def one_line(line: str, call, *arguments, **options) -> None:
    """The call ends in an error that names something; in one line, if it is ours: scikit-learn's may have more."""
    with pytest.raises((ValueError, TypeError), match=line) as error:
        call(*arguments, **options)
    assert len(str(error.value).splitlines()) == 1 or error.type is not UserError


@pytest.mark.parametrize("argument, value, line", IN_FIT.values(), ids=IN_FIT)
def test_a_mistake_in_fit_ends_in_one_line(argument, value, line):
    data, options = {"X": recordings(), "y": Y, "groups": None}, {"params": CHOSEN}
    (data if argument in data else options)[argument] = CHOSEN | value if isinstance(value, dict) else value
    classifier = TactileClassifier(**options)
    one_line(line, classifier.fit, data["X"], data["y"], groups=data["groups"])
    assert not hasattr(classifier, "recogniser_")


def test_options_that_do_not_go_together_end_in_one_line():
    one_line("needs all views", TactileClassifier("best", "stag").fit, recordings(), Y)


@pytest.mark.parametrize(
    "X, line",
    [([np.ones((5, 4, 3))], r"X\[0\].*4 x 3.*4 x 4"), ([], "holds no recordings"), (np.ones((2, 3)), r"X\[0\]")],
)
def test_a_mistake_in_predict_ends_in_one_line(X, line):
    one_line(line, TactileClassifier(system="svm", params=CHOSEN).fit(recordings(), Y).predict, X)


def test_nothing_is_predicted_or_saved_before_fit(tmp_path):
    for call in (lambda new: new.predict(recordings()), lambda new: new.save(tmp_path / "classifier.pt")):
        with pytest.raises(NotFittedError):
            call(TactileClassifier())
    assert not list(tmp_path.iterdir())


def test_a_fit_that_fails_leaves_the_trained_classifier_as_it_was():
    classifier = TactileClassifier(system="svm", params=CHOSEN).fit(recordings(), Y)
    before = classifier.predict_proba(recordings())
    one_line("no sensor varies", classifier.fit, [np.ones((5, 4, 4))] * 4, ["c", "c", "d", "d"])
    assert classifier.classes_.tolist() == ["a", "b"]
    assert (classifier.predict_proba(recordings()) == before).all()
