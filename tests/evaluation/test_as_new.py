"""The tested recordings are answered as `predict` answers recordings of a new session."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.evaluation import as_new
from tactile_viewgcn.evaluation.as_new import right_as_new
from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.messages import EMPTY_HAND, UserError
from tactile_viewgcn.params import default_params
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Answer, Recogniser
from tests.glove_data import CPU, days, views_of

CHANGES = ("model.system=sensors", "model.members=[kernel]", "evaluate.trials=1")
BY_SESSION = ("split.by=session", "split.folds=2", "split.fold=1")  # trained on the first day


def evaluated(folder, recordings, *changes):
    """Return what `right_as_new` takes, after training and evaluation."""
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


def test_a_warning_says_so_if_predict_has_a_higher_error_than_the_evaluation(tmp_path):
    """Trained on one day, the evaluation takes the open hand of the other; `predict` does not."""
    arguments = evaluated(tmp_path, days(120, sessions=2), *BY_SESSION)
    recogniser, recordings, table, whole, params = arguments
    right, (warning,) = right_as_new(recogniser, recordings, table, whole, params)
    assert whole.correct.all()
    assert 0 < right.sum() < len(right)
    assert warning.level == "warning"
    share = f"{100 * (1 - right.mean()):.1f}\N{NO-BREAK SPACE}%"
    assert f"of 20 tested recordings {share} are wrong if `predict`" in warning.text
    assert "no open hand was found" in warning.text
    # the same answers as a session gets whose name says nothing
    for name, label, is_right in zip(whole.recordings, whole.labels, right, strict=True):
        number = recordings.recordings.index(name)
        part = recordings.part(np.flatnonzero(recordings.columns["recording"] == number))
        new = replace(part, sessions=[f"new {session}" for session in part.sessions])
        (answer,), _ = recogniser.answer_table(new)
        assert (answer.probabilities.argmax() == label and answer.contact > 0) == is_right


@pytest.mark.parametrize(
    ("recordings", "by"),
    [
        (days(0, sessions=2), BY_SESSION),
        (days(120, with_empty_hand=True), BY_SESSION),
        (days(120), BY_SESSION),
        (days(120), ("split.by=recording", "split.folds=2")),
    ],
    ids=[
        "the same open hand every day",
        "an empty hand on each day",
        "three days of training",
        "recordings of every day in the training",
    ],
)
def test_there_is_no_warning_where_predict_is_as_good_as_the_evaluation(tmp_path, recordings, by):
    right, notes = right_as_new(*evaluated(tmp_path, recordings, *by))
    assert (right == 1).all()
    assert notes == []


def test_parts_of_recordings_have_no_answer_of_predict(tmp_path):
    """Each recording has two grasps, of which one is tested."""
    recordings = days(120)
    grasp = np.asarray(recordings.columns["frame"] >= 15).astype(np.int16)
    recordings = replace(recordings, columns=recordings.columns | {"grasp": grasp})
    right, notes = right_as_new(*evaluated(tmp_path, recordings, "split.by=grasp", "split.folds=2"))
    assert np.isnan(right).all()
    assert notes == []


@pytest.mark.parametrize(("lost", "gained", "warns"), [(5, 0, False), (6, 0, True), (6, 6, False)])
def test_six_answers_more_that_are_wrong_are_no_chance(lost, gained, warns):
    """By the sign test six losses have p = 1/64, and five have p = 1/32."""
    of_evaluation = np.arange(40) >= gained
    of_predict = np.arange(40) < 40 - lost
    assert len(as_new._warning(of_evaluation, of_predict, [])) == warns


@pytest.mark.parametrize(
    ("contact", "label", "expected"), [(3, 1, True), (3, 0, False), (0, 0, True), (0, 1, False)]
)
def test_without_contact_only_the_empty_hand_is_right(contact, label, expected):
    answer = Answer(np.array([0.4, 0.6], dtype=np.float32), contact, 9, "x")
    assert as_new._is_right(answer, [EMPTY_HAND, "cup"], label) == expected


def test_what_predict_refuses_is_a_warning(tmp_path, monkeypatch):
    recogniser, *given = evaluated(tmp_path, days(0), *BY_SESSION)

    def refuse(table):
        raise UserError("X[3]: the unit is a different one")

    monkeypatch.setattr(recogniser, "answer_table", refuse)
    right, (warning,) = right_as_new(recogniser, *given)
    assert np.isnan(right).all()
    assert warning.level == "warning"
    assert warning.text == "`predict` refuses tested recordings: X[3]: the unit is a different one"
