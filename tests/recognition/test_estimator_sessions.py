"""In Python too, recordings have sessions, and a new session can bring its empty hand."""

import warnings

import numpy as np
import pytest

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.frames.moments import MIN_FRAMES
from tactile_viewgcn.messages import EMPTY_HAND, UserError
from tactile_viewgcn.tables.recordings import NO_SESSION, frames_by_recording
from tests.glove_data import days

SHIFTED = days(120, with_empty_hand=True)


def of_days(*numbers):
    """Return the recordings of some days, the names of their objects, and their days."""
    arrays = []
    names = []
    sessions = []
    for index in frames_by_recording(SHIFTED):
        session = SHIFTED.columns["session"][index[0]]
        if session in numbers:
            arrays.append(SHIFTED.counts[index])
            names.append(SHIFTED.objects[SHIFTED.columns["object"][index[0]]])
            sessions.append(f"day {session}")
    return arrays, np.array(names), sessions


def without_empty_hand(arrays, names):
    """Return recordings of objects, their names, and the recordings of the empty hand."""
    objects = [array for array, name in zip(arrays, names, strict=True) if name != EMPTY_HAND]
    empty = [array for array, name in zip(arrays, names, strict=True) if name == EMPTY_HAND]
    return objects, names[names != EMPTY_HAND], empty


def fitted(*numbers, with_sessions=True, **changes):
    """Return a classifier that was trained on these days."""
    arrays, names, sessions = of_days(*numbers)
    params = {f"preprocess.{key}": value for key, value in changes.items()}
    classifier = TactileClassifier("kernels", params=params)
    return classifier.fit(arrays, names, sessions=sessions if with_sessions else None)


def test_the_empty_hand_of_a_new_day_gives_its_recordings_their_baseline():
    classifier = fitted(0)
    X, truth, empty = without_empty_hand(*of_days(3)[:2])
    with pytest.warns(UserWarning, match="in 20 of 20 recordings no open hand .* empty_hand"):
        answers = classifier.predict(X)
    assert np.mean(answers != truth) > 0.3
    with warnings.catch_warnings(action="error"):
        answers = classifier.predict(X, empty)
        probabilities = classifier.predict_proba(X, empty_hand=empty)
    assert (answers == truth).all()
    assert probabilities.shape == (20, 11)
    # other recordings make no difference
    np.testing.assert_array_equal(classifier.predict_proba(X[3:4], empty), probabilities[3:4])


def test_several_days_show_how_much_an_open_hand_differs_if_they_are_named():
    X, truth, _ = without_empty_hand(*of_days(5)[:2])
    with warnings.catch_warnings(action="error"):
        assert fitted(1, 2, 3).score(X, truth) == 1
    with pytest.warns(UserWarning, match="20 of 20 recordings no open hand"):
        assert fitted(1, 2, 3, with_sessions=False).score(X, truth) < 0.5


def empty_hand_of(*numbers):
    """Return the mean (8, 8) of the empty hand on these days."""
    arrays, names, _ = of_days(*numbers)
    _, _, empty = without_empty_hand(arrays, names)
    return np.mean(empty, axis=(0, 1))


def test_each_session_has_the_baseline_of_its_empty_hand():
    plan = fitted(1, 2, 3, baseline="empty_hand", filter="contact").recogniser_.plan
    assert plan.sessions == ["day 1", "day 2", "day 3"]
    expected = [empty_hand_of(day) for day in (1, 2, 3)]
    np.testing.assert_allclose(plan.baselines, expected, atol=0.5)


def test_without_sessions_all_recordings_share_the_empty_hand():
    classifier = fitted(1, 2, 3, with_sessions=False, baseline="empty_hand", filter="contact")
    plan = classifier.recogniser_.plan
    assert plan.sessions == [NO_SESSION]
    # the mean leaves out outliers
    difference = plan.baselines[0] - empty_hand_of(1, 2, 3)
    assert np.median(np.abs(difference)) < 0.5


def test_answers_do_not_depend_on_other_recordings_whatever_is_cut_off():
    """The sensors rest at 0, where half of their noise is cut off."""
    rng = np.random.default_rng(0)

    def recordings(count):
        counts = np.rint(rng.normal(0, 3, (count, 60, 8, 8)))
        counts[:, 20:50, 2:5, 2:6] += rng.uniform(6, 40, (count, 1, 3, 4))
        return list(np.maximum(counts, 0).astype(int))

    X = recordings(20)
    for array in X[::2]:
        array[20:50, 5:7] += 20
    empty = [np.maximum(np.rint(rng.normal(0, 3, (60, 8, 8))), 0).astype(int) for _ in range(2)]
    y = ["mug", "pen"] * 10
    classifier = TactileClassifier("kernels").fit([*X, *empty], [*y, *["empty_hand"] * 2])
    new = recordings(4)
    expected = classifier.predict_proba(new, empty)
    other = recordings(1)[0]
    other[0, 0, 0] = -1
    longer = np.maximum(recordings(1)[0].repeat(9, axis=0), 1)
    answers = classifier.predict_proba([*new, other, longer], empty)
    np.testing.assert_array_equal(answers[:4], expected)


def test_the_empty_hand_of_a_different_day_is_doubted():
    classifier = fitted(0)
    X, _, empty = without_empty_hand(*of_days(3)[:2])
    _, _, other = without_empty_hand(*of_days(0)[:2])
    match = "in 20 of 20 recordings no open hand was found.*empty_hand is not of their session"
    with pytest.warns(UserWarning, match=match):
        classifier.predict(X, other)
    with warnings.catch_warnings(action="error"):
        classifier.predict(X, empty)


def test_too_short_an_empty_hand_is_named_as_a_reason_of_a_refusal():
    classifier = fitted(0)
    X, _, empty = without_empty_hand(*of_days(3)[:2])
    shifted = [array + 200 for array in X]
    with pytest.raises(UserError, match=r"as in the training: .*; the empty hand .* empty_hand\[0"):
        classifier.predict(shifted, [empty[0][: MIN_FRAMES - 1] + 200])


def test_too_short_an_empty_hand_is_the_only_warning_if_the_recordings_show_an_open_hand():
    X, _, empty = without_empty_hand(*of_days(0)[:2])
    with pytest.warns(UserWarning, match="the empty hand of a session has fewer") as caught:
        fitted(0).predict(X, [empty[0][: MIN_FRAMES - 1]])
    assert len(caught) == 1


def test_an_empty_hand_that_is_not_used_is_named():
    classifier = fitted(0, baseline="none")
    X, _, empty = without_empty_hand(*of_days(0)[:2])
    with pytest.warns(UserWarning, match="the empty hand is not used.*baseline: none"):
        classifier.predict(X, empty)


@pytest.mark.parametrize("frames", [MIN_FRAMES - 1, MIN_FRAMES])
def test_an_empty_hand_of_too_few_frames_is_named(frames):
    """The warning names it, and the answers are those without it."""
    classifier = fitted(0)
    X, _, empty = without_empty_hand(*of_days(3)[:2])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        answers = classifier.predict_proba(X, [empty[0][:frames]])
        without = classifier.predict_proba(X)
    named = "fewer than 5 frames, so it is not used: empty_hand[0]"
    is_named = any(named in str(warning.message) for warning in caught)
    is_unused = np.array_equal(answers, without)
    assert is_named == is_unused == (frames < MIN_FRAMES)


@pytest.mark.parametrize(
    ("empty_hand", "message"),
    [
        ([], "empty_hand is of type list and holds no recordings"),
        ([np.zeros((9, 8, 7), int)], r"empty_hand\[0\]: frames of 8 x 7; expected 8 x 8"),
        (np.zeros((9, 8, 8), int), r"empty_hand \(9, 8, 8\) is one recording; .*\[empty_hand\]"),
        ([np.full((9, 8, 8), 9)], r"empty_hand\[0\].*expected .* or more, as an open hand read"),
    ],
)
def test_a_mistake_in_the_empty_hand_is_named(empty_hand, message):
    X, _, _ = without_empty_hand(*of_days(1)[:2])
    with pytest.raises(UserError, match=message):
        fitted(0).predict(X, empty_hand)
