"""The tested recordings are answered as `predict` answers those of a new session."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.evaluation.as_new import answer_as_new
from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.messages import EMPTY_HAND, UserError
from tactile_viewgcn.params import default_params
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tests.glove_data import CPU, of_arrays, views_of

OBJECTS = 10
SESSIONS = 6
SHAPE = (8, 8)
CHANGES = ("model.system=sensors", "model.members=[kernel]", "evaluate.trials=1")
BY_SESSION = ("split.by=session", "split.folds=2")


def days(shift, *, with_empty_hand=False, **columns):
    """Return recordings (30, 8, 8) of ten objects on six days, two a day, open for ten frames.

    Each day a fifth of the sensors reads higher by about `shift`, as after putting a glove on anew.
    """
    rng = np.random.default_rng(0)
    base = rng.normal(500, 30, SHAPE)
    patterns = np.where(rng.random((OBJECTS, *SHAPE)) < 0.25, 12, 0)
    arrays, labels, sessions = [], [], []

    def add(label, session, pressed):
        counts = base + higher + rng.normal(0, 2, (30, *SHAPE))
        counts[10:25] += pressed
        arrays.append(np.rint(counts).astype(np.int16))
        labels.append(label)
        sessions.append(session)

    for session in range(SESSIONS):
        higher = np.where(rng.random(SHAPE) < 0.2, np.abs(rng.normal(0, shift, SHAPE)), 0)
        for label in range(OBJECTS):
            for _ in range(2):
                add(label + 1, session, patterns[label] * rng.lognormal(0, 0.8, SHAPE))
        if with_empty_hand:
            add(0, session, 0)
    names = [EMPTY_HAND, *(f"object {number}" for number in range(OBJECTS))]
    table = of_arrays(arrays, names, np.array(labels), np.array(sessions))
    return replace(table, columns=table.columns | columns)


def evaluated(folder, recordings, *changes):
    """Return what `answer_as_new` takes, after training and evaluation."""
    params = default_params((*CHANGES, *changes))
    made = preprocess_recordings(recordings, params.preprocess, params.split)
    fitted = fit_classifier(made.frames, views_of(made.frames, params), {}, params, CPU)
    path = folder / "classifier.pt"
    save_classifier(path, fitted.classifier, fitted.model, made.frames, "float32", None)
    recogniser = Recogniser(path)
    predictions, _ = evaluate_table(
        recogniser.classifier, made.frames, params, CPU, temperature=None
    )
    return recogniser, recordings, made.frames, predictions.whole, params


@pytest.mark.parametrize("by", [BY_SESSION, ("split.by=recording", "split.folds=2")])
def test_a_warning_says_so_if_predict_has_a_higher_error_than_the_evaluation(tmp_path, by):
    """The evaluation takes the open hand of each day. On a new day `predict` takes it as held."""
    recogniser, recordings, table, whole, params = evaluated(tmp_path, days(120), *by)
    correct, (warning,) = answer_as_new(recogniser, recordings, table, whole, params)
    assert whole.correct.all()
    assert 0 < correct.sum() < len(correct)
    assert warning.level == "warning"
    share = f"{100 * (1 - correct.mean()):.1f}\N{NO-BREAK SPACE}%"
    assert f"of 60 tested recordings {share} are wrong if `predict`" in warning.text
    assert "no open hand was found" in warning.text
    # the same answers as a session gets whose name says nothing
    for name, label, is_right in zip(whole.recordings, whole.labels, correct, strict=True):
        number = recordings.recordings.index(name)
        part = recordings.part(np.flatnonzero(recordings.columns["recording"] == number))
        new = replace(part, sessions=[f"new {session}" for session in part.sessions])
        (answer,), _ = recogniser.answer_table(new)
        assert (answer.probabilities.argmax() == label and answer.contact > 0) == is_right


@pytest.mark.parametrize(
    "recordings",
    [days(0), days(120, with_empty_hand=True)],
    ids=["the same open hand every day", "an empty hand on each day"],
)
def test_there_is_no_warning_where_predict_is_as_good_as_the_evaluation(tmp_path, recordings):
    correct, notes = answer_as_new(*evaluated(tmp_path, recordings, *BY_SESSION))
    assert correct.all()
    assert notes == []


def test_parts_of_recordings_keep_the_answers_of_the_evaluation(tmp_path):
    """Each recording has two grasps, of which one is tested."""
    recordings = days(120)
    grasp = np.asarray(recordings.columns["frame"] >= 15).astype(np.int16)
    recordings = replace(recordings, columns=recordings.columns | {"grasp": grasp})
    given = evaluated(tmp_path, recordings, "split.by=grasp", "split.folds=2")
    correct, notes = answer_as_new(*given)
    np.testing.assert_array_equal(correct, given[3].correct[0])
    assert notes == []


def test_what_predict_refuses_is_a_warning(tmp_path, monkeypatch):
    recogniser, *given = evaluated(tmp_path, days(0), *BY_SESSION)

    def refuse(table):
        raise UserError("X[3]: the unit is a different one")

    monkeypatch.setattr(recogniser, "answer_table", refuse)
    correct, (warning,) = answer_as_new(recogniser, *given)
    assert correct.all()
    assert warning.level == "warning"
    assert warning.text == "`predict` refuses tested recordings: X[3]: the unit is a different one"
