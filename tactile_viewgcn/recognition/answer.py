"""Answers: the object in the hand, by the frames in contact of one recording, or of each recording of a source."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import softmax

from tactile_viewgcn.messages import EMPTY_HAND, Note
from tactile_viewgcn.nn.network import spread_frames
from tactile_viewgcn.readers.source import UNLABELLED
from tactile_viewgcn.recognition.array_input import checked_array
from tactile_viewgcn.recognition.preprocessing import check_counts, check_strength, find_contact
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.recordings import ArrayRecordings, Recordings, frames_by_recording


@dataclass(frozen=True)
class Answer:
    """The object in a recording.

    Attributes:
        probabilities: (classes,). Without a frame in contact it is the class `empty_hand`, or where there is none, all
            are equally probable.
        used: number of frames that were classified.
        contact: number of frames in contact; frames: number of all frames.
        recording: its name; object: its label, UNLABELLED without one.
    """

    probabilities: np.ndarray
    used: int = 0
    contact: int = 0
    frames: int = 0
    recording: str = ""
    object: str = UNLABELLED


def answer_recording(recogniser: Recogniser, counts: np.ndarray, *, name: str = "counts") -> Answer:
    """The answer to one unlabelled recording of raw counts (T, H, W), in the order of time.

    Baseline and frames in contact are found as in the training, from these frames alone.

    Args:
        name: of the counts, in errors.

    Raises:
        UserError: counts of a different shape or type, not finite, or outside int32.
    """
    one = np.zeros(1, dtype=int)
    recordings = ArrayRecordings([checked_array(counts, name)], [UNLABELLED], one, one)
    recordings.path = Path(name)
    ((answer,), _) = answer_table(recogniser, recordings, any_scale=True)
    return answer


def answer_table(
    recogniser: Recogniser,
    recordings: Recordings,
    *,
    any_scale: bool = False,
) -> tuple[list[Answer], list[Note]]:
    """The answers to the recordings of a table, and notes on baselines that could not be measured.

    Args:
        any_scale: allow readings in contact that are much stronger or weaker than the training's.

    Raises:
        UserError: recordings unlike the training's in form or scale; see `answer_recording`.
    """
    fitted, columns = recogniser.preprocessing, recordings.columns
    for _, counts in recordings.blocks():
        check_counts(fitted, counts, str(recordings.path))
    recordings = recordings.part(np.arange(len(recordings)), fitted.live)
    answers, classified = [], []
    baseline, contact = find_contact(fitted, recordings)
    for index in frames_by_recording(recordings):
        pressed = index[contact[index]]
        excess = recordings.counts[pressed] - baseline.mean[baseline.of_frame[pressed]]
        classified.append(excess[spread_frames(len(pressed), recogniser.classifier.views)] if len(pressed) else excess)
        answer = replace(
            answer_contact(recogniser, excess),
            frames=len(index),
            recording=recordings.recordings[columns["recording"][index[0]]],
            object=_common(recordings.objects[number] for number in columns["object"][index]),
        )
        answers.append(answer)
    if not any_scale:
        check_strength(fitted, np.concatenate(classified), str(recordings.path))
    return answers, baseline.notes


def _common(objects: Iterable[str]) -> str:
    """The one object's name that all have, else UNLABELLED."""
    names = set(objects)
    return names.pop() if len(names) == 1 else UNLABELLED


def answer_contact(recogniser: Recogniser, excess: np.ndarray) -> Answer:
    """The answer to a recording by its n frames in contact: all, or for a network some, evenly spaced.

    Args:
        excess: (n, H, W) counts above baseline, in the order of time.
    """
    if not len(excess):
        return Answer(_without_contact(recogniser))
    probabilities, used = recogniser.of_recording(excess, "subtracted")
    return Answer(probabilities, used, len(excess))


def _without_contact(recogniser: Recogniser) -> np.ndarray:
    """Probabilities (classes,) of the empty hand, or of all classes alike where it is none."""
    empty = np.array([name == EMPTY_HAND for name in recogniser.classes], dtype=np.float32)
    return empty if empty.any() else np.full(len(empty), 1 / len(empty), dtype=np.float32)


def answer_together(recogniser: Recogniser, answers: list[Answer], name: str = "together") -> Answer:
    """The answer to one object that was recorded several times, from the answers to its recordings.

    Their log-probabilities are added. Recordings without contact do not count.

    Args:
        name: stands in the place of the recording's.
    """
    pressed, probabilities = [answer for answer in answers if answer.contact], _without_contact(recogniser)
    if pressed:
        shares = np.maximum([answer.probabilities for answer in pressed], np.finfo(np.float32).tiny)
        probabilities = softmax(np.log(shares).sum(axis=0))
    return Answer(
        probabilities,
        used=sum(answer.used for answer in answers),
        contact=sum(answer.contact for answer in answers),
        frames=sum(answer.frames for answer in answers),
        recording=name,
        object=_common(answer.object for answer in answers),
    )
