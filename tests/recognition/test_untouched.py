"""A hand that touches nothing is the class `empty_hand`, or it is any object, with a warning."""

import warnings
from functools import partial

import numpy as np
import pytest

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.recognition.mlflow_model import RecogniserModel
from tactile_viewgcn.recognition.recogniser import Recogniser, recording_of

OBJECTS = ["ball", "cup", "pen"]
EMPTY = 3  # label of the empty hand


def array(label, rng, *, open_frames=0, offset=500.0, size=16, floor=-np.inf):
    """Return counts (30, size, size) of an object that presses a few rows.

    Args:
        label: index of the object, or EMPTY.
        rng: generator of the noise and the force.
        open_frames: number of frames before the contact.
        offset: counts of a sensor without contact.
        size: number of rows and of columns.
        floor: the smallest reading of the sensors.
    """
    counts = offset + rng.normal(0, 1, (30, size, size))
    rows = size // 4
    if label < EMPTY:
        counts[open_frames:, rows * label : rows * (label + 1)] += rng.uniform(
            20, 60, (30 - open_frames, rows, size)
        )
    return np.maximum(counts, floor)


def channels(label, rng):
    """Return a recording (30, 6) of six channels. An object presses two of them."""
    counts = rng.normal(0, 1, (30, 6))
    if label < EMPTY:
        counts[:, 2 * label : 2 * label + 2] += rng.uniform(20, 60, (30, 2))
    return counts


def whole_counts(label, rng):
    """Return whole counts (30, 8, 8) of an object that presses two rows."""
    return np.rint(array(label, rng, size=8)).astype(int)


GLOVES = {
    "an array, the hand open first": partial(array, open_frames=10),
    "an array, all contact": array,
    "an array without an offset": partial(array, offset=0.0),
    "an array cut off at 0": partial(array, offset=0.0, floor=0.0),
    "a small array cut off at 0": partial(array, offset=0.0, size=8, floor=0.0),
    "a small array in whole counts": whole_counts,
    "channels": channels,
}
EVERY_FRAME = {"preprocess.filter": "none"}
SETTINGS = {"chosen by the recordings": {}, "every frame": EVERY_FRAME}


def fitted(glove, params, *, with_empty_hand):
    """Return a classifier, its recordings and the names of their objects.

    There are five recordings of each object, and of the empty hand if it is a class.
    """
    rng = np.random.default_rng(0)
    labels = np.tile(np.arange(EMPTY), 5)
    if with_empty_hand:
        labels = np.concatenate([labels, np.full(5, EMPTY)])
    X = [glove(label, rng) for label in labels]
    y = np.array([*OBJECTS, "empty_hand"])[labels]
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
    new = [glove(label, rng) for label in [*range(EMPTY + 1)] * 10]
    assert (classifier.predict(new) == [*OBJECTS, "empty_hand"] * 10).all()


@pytest.mark.parametrize("params", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("glove", GLOVES.values(), ids=GLOVES)
def test_without_that_class_an_open_hand_is_any_object_and_those_beside_it_are_answered(
    tmp_path, glove, params
):
    classifier, _, _ = fitted(glove, params, with_empty_hand=False)
    rng = np.random.default_rng(1)
    held = glove(1, rng)
    opened = [glove(EMPTY, rng) for _ in range(3)]
    (expected,) = classifier.predict_proba([held])
    with pytest.warns(UserWarning, match=r"X\[0\], X\[2\]"):
        together = classifier.predict_proba([opened[0], held, opened[1]])
    np.testing.assert_array_equal(together[1], expected)
    assert expected.argmax() == 1
    np.testing.assert_allclose(together[::2], 1 / 3)
    with pytest.warns(UserWarning, match=r"X\[0\]"):
        np.testing.assert_allclose(classifier.predict_proba([opened[2]]), 1 / 3)
    classifier.save(tmp_path / "classifier.pt")
    request = {"recordings": [opened[0].tolist(), held.tolist()]}
    served = RecogniserModel(Recogniser(tmp_path / "classifier.pt")).predict(request)
    np.testing.assert_allclose(served, together[:2], atol=1e-6)


def test_an_untouched_recording_has_one_note():
    """Its frames count as contact, so there is no note on missing contact too."""
    classifier, _, _ = fitted(array, EVERY_FRAME, with_empty_hand=True)
    new = recording_of(array(EMPTY, np.random.default_rng(1)), "new")
    answers, notes = classifier.recogniser_.answer_recordings([new])
    assert answers[0].contact == 0
    assert [note.text.split(":")[0] for note in notes] == [
        "1 of 1 recording read less than a quarter of the training's weakest "
        f"({classifier.recogniser_.plan.strong_readings[0][0]:.3g} off the baseline), "
        "as a hand that touches nothing"
    ]


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
    """The noise is multiplied by the same factor as the pressure."""
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
    X = [channels(label, rng) for label in [*range(EMPTY + 1)] * 5]
    X[3][10:13] = 3000.0  # the hand hit the table
    y = [*OBJECTS, "empty_hand"] * 5
    classifier = TactileClassifier("kernels", params=EVERY_FRAME).fit(X, y)
    assert len(classifier.predict(X)) == len(X)
