"""Answers the tested recordings one by one, as `predict` answers new recordings.

The evaluation takes the open hand that a recording shows. `predict` knows no other recording of its
session. So it takes an open hand only if that reads like the training set's, since it could be an
object that is held. The two can find other frames in contact, and then their errors differ.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactile_viewgcn.evaluation.trials import Trials
from tactile_viewgcn.frames.baseline import with_empty_hand
from tactile_viewgcn.intervals import percent
from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.params import Params
from tactile_viewgcn.recognition.recogniser import Answer, Recogniser
from tactile_viewgcn.tables.frames import SIDES, Frames
from tactile_viewgcn.tables.recordings import NO_SESSION, Recordings

TOPIC = "as new"
CHANCE = 0.025  # largest p of the one-sided sign test at which `predict` counts as worse


def answer_as_new(
    recogniser: Recogniser, recordings: Recordings, table: Frames, whole: Trials, params: Params
) -> tuple[np.ndarray, list[Note]]:
    """Return whether `predict` answers each tested recording rightly, and a warning if it errs.

    Of a session, `predict` gets the tested recording and the empty hand. It does not get the
    session's name, so every session is new to it.

    Args:
        recogniser: the trained recogniser.
        recordings: raw counts of all sets.
        table: the kept frames.
        whole: the evaluation's answers to whole recordings.
        params: `evaluate.side`, which names the evaluated set.

    Returns:
        Bool (A,), whether each answer of `whole` is right as the answer of `predict`. For parts of
            recordings, as in a split by grasps, it is the evaluation's answer. There is a warning
            if `predict` is wrong more often than the evaluation, by the sign test of McNemar
            (1947), or if it refuses the recordings.
    """
    correct = whole.correct[0].copy()
    numbers = _tested_as_a_whole(table, SIDES.index(params.evaluate.side))
    names = np.array(recordings.recordings)[numbers]
    tested = np.flatnonzero(np.isin(whole.recordings, names))
    if not len(tested):
        return correct, []
    rows = with_empty_hand(recordings, np.isin(recordings.columns["recording"], numbers))
    nameless = [NO_SESSION] * len(recordings.sessions)
    new = replace(recordings.part(rows), sessions=nameless)
    try:
        answers, notes = recogniser.answer_table(new)
    except UserError as error:
        text = f"`predict` refuses tested recordings: {error}"
        return correct, [Note(text, "warning", TOPIC)]
    answer_of = {answer.recording: answer for answer in answers}
    for row in tested:
        answer = answer_of[whole.recordings[row]]
        correct[row] = _is_right(answer, int(whole.labels[row]))
    return correct, _warning(whole.correct[0][tested], correct[tested], notes)


def _tested_as_a_whole(table: Frames, side: int) -> np.ndarray:
    """Return the numbers of the recordings whose kept frames are one split group of a set."""
    frames = table.columns.groupby("recording")
    parts = frames.agg(lowest=("side", "min"), highest=("side", "max"), groups=("group", "nunique"))
    is_whole = (parts["lowest"] == side) & (parts["highest"] == side) & (parts["groups"] == 1)
    numbers: np.ndarray = parts.index[is_whole].to_numpy()
    return numbers


def _is_right(answer: Answer, label: int) -> bool:
    """Return whether an answer is right; without contact and a class for it, there is no answer."""
    probabilities = answer.probabilities
    has_answer = bool(answer.contact) or probabilities.max() == 1
    return has_answer and int(probabilities.argmax()) == label


def _warning(of_evaluation: np.ndarray, correct: np.ndarray, notes: Sequence[Note]) -> list[Note]:
    """Return a warning if `predict` is wrong more often than the evaluation, and not by chance.

    Args:
        of_evaluation: bool (n,), whether the evaluation's answers are right.
        correct: bool (n,), whether the answers of `predict` are right.
        notes: the notes of `predict` on these recordings.
    """
    from scipy.stats import binomtest

    lost = int((of_evaluation & ~correct).sum())
    gained = int((correct & ~of_evaluation).sum())
    if not lost or binomtest(lost, lost + gained, alternative="greater").pvalue > CHANCE:
        return []
    errors = [percent(1 - right.mean()) for right in (correct, of_evaluation)]
    text = f"of {several(len(correct), 'tested recording')} {errors[0]} are wrong if `predict` "
    text += f"answers each of them as a new recording, and {errors[1]} in the evaluation. "
    text += "`predict` takes an open hand only if it reads like the training set's, or if the "
    text += "session has recordings named empty_hand. Record the empty hand in each session"
    said = [note.text for note in notes if note.topic == "baseline"]
    if said:
        text += f". `predict` says: {'; '.join(said)}"
    return [Note(text, "warning", TOPIC)]
