"""The trained recogniser: the object in the hand, from the raw counts of one recording or of a table of recordings."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import softmax

from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError
from tactile_viewgcn.params import on_sensors
from tactile_viewgcn.readers.source import MAX_PRESSURE, UNLABELLED, check_shape, storage_type
from tactile_viewgcn.recognition.model_file import load_classifier
from tactile_viewgcn.recognition.raw_counts import check_counts, check_strength, find_contact
from tactile_viewgcn.tables.recordings import ArrayRecordings, Recordings, frames_by_recording


@dataclass(frozen=True)
class Answer:
    """The object in a recording.

    Attributes:
        probabilities: float32 (classes,). Without a frame in contact it is the class `empty_hand`, or where there is
            none, all are equally probable.
        contact: number of frames in contact; frames: number of all frames.
        recording: its name; object: its label, UNLABELLED without one.
    """

    probabilities: np.ndarray
    contact: int = 0
    frames: int = 0
    recording: str = ""
    object: str = UNLABELLED


class Recogniser:
    """A trained classifier of recordings.

    Args:
        path: a file that `save_classifier` wrote.

    Attributes:
        classes: names.
        shape: (H, W) of a frame.
        system: name of the system, or of the members of `sensors`.
        calibrated: whether the probabilities are.
        preprocessing: that of the training.
    """

    def __init__(self, path: str | Path):
        self.classifier, self.content = load_classifier(path)
        model, self.preprocessing = self.content.model, self.content.preprocessing
        self.classes, self.calibrated = self.content.classes, self.content.temperature is not None
        self.system = " + ".join(model.members) if on_sensors(model.system) else model.system
        self.shape = self.preprocessing.live.shape

    def answer(self, counts: Any, name: str = "counts", *, any_scale: bool = False) -> Answer:
        """The answer to one recording of raw counts (T, H, W), or of channels (T, C), in the order of time.

        Baseline and frames in contact are found as in the training, from these frames alone.

        Args:
            name: of the counts, in errors.
            any_scale: see `answer_table`.

        Raises:
            UserError: see `recording_array` and `answer_table`.
        """
        one = np.zeros(1, dtype=int)
        recordings = ArrayRecordings([recording_array(counts, name)], [UNLABELLED], one, one)
        recordings.path = Path(name)
        return self.answer_table(recordings, any_scale=any_scale)[0][0]

    def answer_table(self, recordings: Recordings, *, any_scale: bool = False) -> tuple[list[Answer], list[Note]]:
        """The answers to the recordings of a table, and notes on baselines that could not be measured.

        Args:
            any_scale: allow recordings whose readings in contact are much stronger or weaker than the training's.

        Raises:
            UserError: a recording unlike the training's in form or scale.
        """
        fitted, columns = self.preprocessing, recordings.columns
        for _, counts in recordings.blocks():
            check_counts(fitted, counts, str(recordings.path))
        recordings = recordings.part(np.arange(len(recordings)), fitted.live)
        answers, path = [], str(recordings.path)
        baseline, contact = find_contact(fitted, recordings)
        for index in frames_by_recording(recordings):
            name = recordings.recordings[columns["recording"][index[0]]]
            pressed = index[contact[index]]
            excess = recordings.counts[pressed] - baseline.mean[baseline.of_frame[pressed]]
            label = _common(recordings.objects[number] for number in columns["object"][index])
            if not any_scale and label != EMPTY_HAND:
                check_strength(fitted, excess, path if len(recordings.recordings) == 1 else f"{path}, {name}")
            answers.append(replace(self.answer_contact(excess), frames=len(index), recording=name, object=label))
        return answers, baseline.notes

    def answer_contact(self, excess: np.ndarray) -> Answer:
        """The answer to a recording by its n frames in contact, counts (n, H, W) above baseline."""
        if not len(excess):
            return Answer(self._without_contact())
        return Answer(np.exp(self.content.answer(self.classifier, excess), dtype=np.float32), len(excess))

    def answer_together(self, answers: list[Answer], name: str) -> Answer:
        """The answer to one object that was recorded several times, from the answers to its recordings.

        Their log-probabilities are added, as of independent recordings. Recordings without contact do not count.
        """
        shares = [answer.probabilities for answer in answers if answer.contact] or [self._without_contact()]
        logarithms = np.log(np.maximum(shares, np.finfo(np.float32).tiny), dtype=np.float64).sum(axis=0)
        contact, frames = (sum(getattr(each, name) for each in answers) for name in ("contact", "frames"))
        label = _common(answer.object for answer in answers)
        return Answer(softmax(logarithms).astype(np.float32), contact, frames, name, label)

    def _without_contact(self) -> np.ndarray:
        """Probabilities (classes,) of the empty hand, or of all classes alike where it is none."""
        empty = np.array([name == EMPTY_HAND for name in self.classes], dtype=np.float32)
        return empty if empty.any() else np.full(len(empty), 1 / len(empty), dtype=np.float32)


def _common(objects: Iterable[str]) -> str:
    """The one object's name that all have, else UNLABELLED."""
    names = set(objects)
    return names.pop() if len(names) == 1 else UNLABELLED


def recording_array(recording: Any, name: str, *, frames_last: bool = False) -> np.ndarray:
    """One recording as counts (T, H, W) of the type in which pressure is stored; channels (T, C) as frames of one row.

    Args:
        frames_last: time is the last axis instead of the first.

    Raises:
        UserError: begins with `name`; other axes or types, no frames, or values that the type cannot hold.
    """
    try:
        array = np.asarray(recording)
    except ValueError:
        raise UserError(f"{name} is ragged; expected frames of equal size, (frames, rows, columns)") from None
    if frames_last and array.ndim:
        array = np.moveaxis(array, -1, 0)
    array = array[:, None] if array.ndim == 2 else array
    check_shape(array.shape, name)
    if array.dtype.kind not in "iuf":
        raise UserError(f"{name} is of type {array.dtype}; expected integer counts or real numbers")
    unfit = np.argwhere(~(np.abs(array) <= np.float64(MAX_PRESSURE)))  # float16 has no such number
    if len(unfit):
        place = "frame {}, row {}, column {}".format(*unfit[0])
        raise UserError(f"{name} holds {array[tuple(unfit[0])]:g} in {place}; expected numbers up to {MAX_PRESSURE:g}")
    if not len(array):
        raise UserError(f"{name} has no frames; expected one or more")
    dtype = storage_type(array.dtype, name)
    if dtype.kind == "i" and (array.min() < np.iinfo(dtype).min or array.max() > np.iinfo(dtype).max):
        raise UserError(f"{name} holds counts from {array.min()} to {array.max()}; expected them in {dtype}")
    return array.astype(dtype, copy=False)
