"""The estimator names each mistake of its user in one line, and trains nothing."""

import numpy as np
import pytest
from sklearn.exceptions import NotFittedError

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.messages import UserError

pytestmark = pytest.mark.filterwarnings("ignore:answers to recordings")  # the labels are at random
CHOSEN = {"preprocess.baseline": "none", "preprocess.zero": 0, "preprocess.filter": "none"}
Y = ["a", "a", "b", "b"]


def recordings(count: int = 4) -> list[np.ndarray]:
    """Return recordings (5, 4, 4) of counts above baseline."""
    return list(np.random.default_rng(0).integers(0, 50, (count, 5, 4, 4), dtype=np.int16))


def with_third(recording) -> list:
    """Return four recordings, of which the third is the given one."""
    return [*recordings(2), recording, *recordings(1)]


#: An argument of `fit` or of the classifier, its value, and a part of the message
IN_FIT = {
    "no recordings": ("X", [], "list and holds no recordings"),
    "one recording, not in a list": ("X", recordings()[0], r"\[5, 4\]"),
    "rows of sensors": ("X", np.ones((4, 9)), r"X\[0\].*\(9,\).*\(frames, rows, columns\)"),
    "a ragged frame": ("X", with_third([[[1, 2], [3]]]), r"X\[2\] is ragged"),
    "a different layout": (
        "X",
        [*recordings(1), *[np.ones((5, 4, 3))] * 3],
        r"X\[1\].*4 x 3.*4 x 4",
    ),
    "no frames": ("X", with_third(np.ones((0, 4, 4))), r"X\[2\] has no frames"),
    "NaN": (
        "X",
        with_third(np.full((5, 4, 4), np.nan)),
        r"X\[2\] holds nan in frame 0, row 0, column 0",
    ),
    "counts too large": (
        "X",
        with_third(np.full((5, 4, 4), 2**40)),
        r"X\[2\] holds 1.09951e\+12 in frame 0",
    ),
    "texts": ("X", with_third(np.full((5, 4, 4), "1")), r"X\[2\].*<U1"),
    "no sensor varies": ("X", [np.ones((5, 4, 4))] * 4, "no sensor varies"),
    "labels of a different length": ("y", ["a", "b"], r"\[4, 2\]"),
    "one class": ("y", ["a"] * 4, "y has one class, a"),
    "a missing label": ("y", ["a", "a", "b", None], "y holds labels of different kinds"),
    "groups of a different length": ("groups", [0, 1, 2], r"groups.*\(3,\).*\(4,\)"),
    "a missing group": ("groups", ["a", None, "a", "b"], r"groups\[1\] is missing"),
    "a missing group among texts": ("groups", ["a", np.nan, "a", "b"], r"groups\[1\] is missing"),
    "groups of texts and numbers": (
        "groups",
        ["a", 1, "a", "b"],
        "groups holds values of different",
    ),
    "groups of different kinds": (
        "groups",
        np.array(["a", 1, "a", "b"], dtype=object),
        "groups holds values of different kinds",
    ),
    "sessions of a different length": ("sessions", [0, 1], r"sessions.*\(2,\).*\(4,\)"),
    "a missing session": (
        "sessions",
        ["a", None, "a", "b"],
        r"sessions\[1\] is missing; expected a session",
    ),
    "no such system": ("system", "mvccn", "model.system: .*'mvccn'.*did you mean mvcnn"),
    "a value YAML has not": (
        "params",
        {"preprocess.scale": object()},
        "preprocess.scale: .*<object",
    ),
    "a shape of frames": (
        "params",
        {"data.shape": [2, 8]},
        r"data.shape is \[2, 8\]; here expected",
    ),
    "a key of the pipeline": ("params", {"split.folds": 4}, "split.folds, which only the pipeline"),
    "params as a text": ("params", "views=4", "'views=4'"),
}


def mistake_has_one_line(message: str, call, *arguments, **options) -> None:
    """Check that a call ends in an error with a message, in one line if the error is ours.

    Errors of scikit-learn can have more lines.
    """
    with pytest.raises((ValueError, TypeError), match=message) as error:
        call(*arguments, **options)
    if error.type is UserError:
        assert len(str(error.value).splitlines()) == 1


def test_two_presets_are_refused():
    classifier = TactileClassifier(preset="kernels", system="network")
    mistake_has_one_line(
        "'kernels' and system is 'network'", classifier.fit, recordings(), [*"aabb"]
    )


@pytest.mark.parametrize("argument, value, message", IN_FIT.values(), ids=IN_FIT)
def test_a_mistake_in_fit_ends_in_one_line(argument, value, message):
    data = {"X": recordings(), "y": Y, "groups": None, "sessions": None}
    options = {"params": CHOSEN}
    if isinstance(value, dict):
        value = CHOSEN | value
    if argument in data:
        data[argument] = value
    else:
        options[argument] = value
    classifier = TactileClassifier(**options)
    mistake_has_one_line(message, classifier.fit, **data)
    assert not hasattr(classifier, "recogniser_")


@pytest.mark.parametrize(
    "X, message",
    [
        (np.ones((2, 3)), r"X\[0\] is a frame \(3,\).*\[X\]"),
        (recordings()[0], r"X \(5, 4, 4\) is one recording; .*\[X\]"),
        ([*recordings()[0]], r"X\[0\]: frames of 1 x 4; expected 4 x 4.*\[X\]"),
        ([[[[True] * 4] * 4]], r"X\[0\] holds true"),
    ],
)
def test_a_mistake_in_predict_ends_in_one_line(X, message):
    classifier = TactileClassifier(system="svm", params=CHOSEN).fit(recordings(), Y)
    mistake_has_one_line(message, classifier.predict, X)


def test_nothing_is_predicted_or_saved_before_fit(tmp_path):
    with pytest.raises(NotFittedError):
        TactileClassifier().predict(recordings())
    with pytest.raises(NotFittedError):
        TactileClassifier().save(tmp_path / "classifier.pt")
    assert not list(tmp_path.iterdir())
