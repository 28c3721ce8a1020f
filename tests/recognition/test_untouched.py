"""Recordings of a hand that touches nothing: the class `empty_hand`, or equal probabilities and a
warning.
"""

import warnings

import numpy as np
import pytest

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.recognition.mlflow_model import RecogniserModel
from tactile_viewgcn.recognition.recogniser import Recogniser

OBJECTS = ["ball", "cup", "pen"]
EMPTY = 3  # number of the empty hand


def array(number, rng, *, opened=0, offset=500.0, side=16, floor=-np.inf):
    """Return a recording (30, side, side) of an object that presses a few rows, with `opened`
    frames without it first.
    """
    counts = offset + rng.normal(0, 1, (30, side, side))
    rows = side // 4
    if number < EMPTY:
        counts[opened:, rows * number : rows * (number + 1)] += rng.uniform(
            20, 60, (30 - opened, rows, side)
        )
    return np.maximum(counts, floor)


def channels(number, rng):
    """Return a recording (30, 6) of six channels; an object presses two of them."""
    counts = rng.normal(0, 1, (30, 6))
    if number < EMPTY:
        counts[:, 2 * number : 2 * number + 2] += rng.uniform(20, 60, (30, 2))
    return counts


GLOVES = {
    "an array, the hand open first": lambda number, rng: array(number, rng, opened=10),
    "an array, all contact": array,
    "an array without an offset": lambda number, rng: array(number, rng, offset=0.0),
    "an array cut off at 0": lambda number, rng: array(number, rng, offset=0.0, floor=0.0),
    "a small array cut off at 0": lambda number, rng: array(
        number, rng, offset=0.0, side=8, floor=0.0
    ),
    "a small array in whole counts": lambda number, rng: np.rint(array(number, rng, side=8)).astype(
        int
    ),
    "channels": channels,
}
EVERY_FRAME = {"preprocess.filter": "none"}
SETTINGS = {"chosen by the recordings": {}, "every frame": EVERY_FRAME}


def fitted(glove, params, *, with_empty_hand):
    """Return a classifier, its recordings and their labels: 5 of each object, and of the empty hand
    if it is a class.
    """
    rng, number = np.random.default_rng(0), np.tile(np.arange(EMPTY), 5)
    if with_empty_hand:
        number = np.concatenate([number, np.full(5, EMPTY)])
    X, y = [glove(each, rng) for each in number], np.array([*OBJECTS, "empty_hand"])[number]
    with warnings.catch_warnings(action="ignore"):
        return TactileClassifier("kernels", params=params).fit(X, y), X, y


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("params", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("glove", GLOVES.values(), ids=GLOVES)
def test_a_classifier_with_the_class_empty_hand_answers_its_own_recordings_and_new_ones(
    glove, params
):
    classifier, X, y = fitted(glove, params, with_empty_hand=True)
    assert (classifier.predict(X) == y).all()
    rng = np.random.default_rng(1)
    new = [glove(number, rng) for number in [*range(EMPTY + 1)] * 10]
    assert (classifier.predict(new) == [*OBJECTS, "empty_hand"] * 10).all()


@pytest.mark.parametrize("params", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("glove", GLOVES.values(), ids=GLOVES)
def test_without_that_class_an_open_hand_is_any_object_and_those_beside_it_are_answered(
    tmp_path, glove, params
):
    classifier, _, _ = fitted(glove, params, with_empty_hand=False)
    rng = np.random.default_rng(1)
    held, opened = glove(1, rng), [glove(EMPTY, rng) for _ in range(3)]
    alone = classifier.predict_proba([held])
    with pytest.warns(UserWarning, match=r"X\[0\], X\[2\]"):
        beside = classifier.predict_proba([opened[0], held, opened[1]])
    np.testing.assert_array_equal(beside[1], alone[0])
    assert alone[0].argmax() == 1
    np.testing.assert_allclose(beside[::2], 1 / 3)
    with pytest.warns(UserWarning, match=r"X\[0\]"):
        np.testing.assert_allclose(classifier.predict_proba([opened[2]]), 1 / 3)
    classifier.save(tmp_path / "classifier.pt")
    request = {"recordings": [opened[0].tolist(), held.tolist()]}
    served = RecogniserModel(Recogniser(tmp_path / "classifier.pt")).predict(request)
    np.testing.assert_allclose(served, beside[:2], atol=1e-6)


@pytest.mark.parametrize("name", ["an array, all contact", "channels"])
def test_a_single_frame_shows_no_noise_and_may_still_be_of_an_open_hand(name):
    classifier, X, _ = fitted(GLOVES[name], EVERY_FRAME, with_empty_hand=False)
    opened = GLOVES[name](EMPTY, np.random.default_rng(1))[:1]
    with pytest.warns(UserWarning, match=r"X\[1\]"):
        shares = classifier.predict_proba([X[0][:1], opened])
    assert shares[0].argmax() == 0
    np.testing.assert_allclose(shares[1], 1 / 3)


@pytest.mark.parametrize(
    "name", ["an array, all contact", "an array without an offset", "channels"]
)
@pytest.mark.parametrize("times", [1 / 300, 1 / 1000, 300])
@pytest.mark.parametrize("with_empty_hand", [False, True])
def test_another_unit_is_no_open_hand_where_every_frame_is_taken(name, times, with_empty_hand):
    """The noise is smaller too."""
    classifier, X, _ = fitted(GLOVES[name], EVERY_FRAME, with_empty_hand=with_empty_hand)
    with pytest.raises(UserError, match="unit"):
        classifier.predict([times * X[0]])


@pytest.mark.parametrize("times", [0.0, 1 / 300])
def test_another_unit_in_which_no_contact_is_found_is_no_empty_hand(times):
    classifier, X, _ = fitted(GLOVES["an array, the hand open first"], {}, with_empty_hand=True)
    with pytest.raises(UserError, match="unit"):
        classifier.predict([times * X[0]])


def test_an_empty_hand_that_once_read_far_more_than_the_objects_is_answered():
    rng = np.random.default_rng(0)
    X = [channels(number, rng) for number in [*range(EMPTY + 1)] * 5]
    X[3][10:13] = 3000.0  # the hand hit the table
    y = [*OBJECTS, "empty_hand"] * 5
    classifier = TactileClassifier("kernels", params=EVERY_FRAME).fit(X, y)
    assert len(classifier.predict(X)) == len(X)
