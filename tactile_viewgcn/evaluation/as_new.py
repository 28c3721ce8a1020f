"""Answers the tested recordings as `predict` answers recordings of a new session.

The evaluation takes the open hand that a recording shows. `predict` knows no other recording of its
session. So it takes an open hand only if that reads like the training set's, since it could be an
object that is held. The two can find other frames in contact, and then their errors differ.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactile_viewgcn.evaluation.live import numbered_grasps
from tactile_viewgcn.evaluation.trials import Trials
from tactile_viewgcn.frames.baseline import with_empty_hand
from tactile_viewgcn.intervals import percent
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, several
from tactile_viewgcn.params import Params
from tactile_viewgcn.recognition.recogniser import Answer, Recogniser
from tactile_viewgcn.tables.frames import SIDES, Frames
from tactile_viewgcn.tables.recordings import NO_SESSION, Recordings

TOPIC = "as new"
LARGEST_P = 0.025  # of the one-sided sign test at which `predict` counts as worse


def right_as_new(
    recogniser: Recogniser, recordings: Recordings, table: Frames, whole: Trials, params: Params
) -> tuple[np.ndarray, list[Note]]:
    """Return which tested recordings `predict` would answer rightly if their session were new.

    Of a session, `predict` gets a tested recording and the empty hand, but no name.

    Args:
        recogniser: the trained recogniser.
        recordings: raw counts of all sets.
        table: the kept frames.
        whole: the evaluation's answers to whole recordings.
        params: `evaluate.side`, which names the evaluated set.

    Returns:
        For each answer of `whole` (A,), 1 if `predict` is right, and 0 if it is wrong. NaN if only
            a part of the recording is tested, as in a split by grasps, or if `predict` refuses the
            recordings. There is a warning if it does, and if it is wrong more often than the
            evaluation by the sign test of McNemar (1947).
    """
    is_right = np.full(len(whole.labels), np.nan)
    numbers = _tested_as_a_whole(table, SIDES.index(params.evaluate.side))
    names = np.array(recordings.recordings)[numbers]
    tested = np.flatnonzero(np.isin(whole.recordings, names))
    if not len(tested):
        return is_right, []
    rows = with_empty_hand(recordings, np.isin(recordings.columns["recording"], numbers))
    nameless = [NO_SESSION] * len(recordings.sessions)
    try:
        answers, notes = recogniser.answer_table(replace(recordings.part(rows), sessions=nameless))
    except UserError as error:
        text = f"`predict` refuses tested recordings: {error}"
        return is_right, [Note(text, "warning", TOPIC)]
    answer_of = {answer.recording: answer for answer in answers}
    for row in tested:
        answer = answer_of[whole.recordings[row]]
        is_right[row] = _is_right(answer, recogniser.classes, int(whole.labels[row]))
    return is_right, _warning(whole.correct[0][tested], is_right[tested] == 1, notes)


def _tested_as_a_whole(table: Frames, side: int) -> np.ndarray:
    """Return the numbers of the recordings that lie in the evaluated set and in one split group."""
    grasps = numbered_grasps(table, side).groupby("recording")
    is_whole = grasps["is_tested"].all() & (grasps["group"].nunique() == 1)
    numbers: np.ndarray = is_whole.index[is_whole].to_numpy()
    return numbers


def _is_right(answer: Answer, classes: Sequence[str], label: int) -> bool:
    """Return whether an answer is right; without contact only the empty hand can be right."""
    if not answer.contact:
        return classes[label] == EMPTY_HAND
    return int(answer.probabilities.argmax()) == label


def _warning(
    of_evaluation: np.ndarray, of_predict: np.ndarray, notes: Sequence[Note]
) -> list[Note]:
    """Return a warning if `predict` is wrong more often than the evaluation, and not by chance.

    Args:
        of_evaluation: bool (n,), whether the evaluation's answers are right.
        of_predict: bool (n,), whether the answers of `predict` are right.
        notes: the notes of `predict` on these recordings.
    """
    from scipy.stats import binomtest

    lost = int((of_evaluation & ~of_predict).sum())
    gained = int((of_predict & ~of_evaluation).sum())
    if not lost or binomtest(lost, lost + gained, alternative="greater").pvalue > LARGEST_P:
        return []
    errors = [percent(1 - right.mean()) for right in (of_predict, of_evaluation)]
    text = f"of {several(len(of_predict), 'tested recording')} {errors[0]} are wrong if `predict` "
    text += f"answers them as recordings of a new session, and {errors[1]} in the evaluation"
    said = [note.text for note in notes if note.topic == "baseline"]
    if said:
        text += f". `predict` says: {'; '.join(said)}"
    return [Note(text, "warning", TOPIC)]
