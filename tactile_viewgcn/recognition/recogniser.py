"""The trained recogniser: it says from raw counts which object a hand holds."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactile_viewgcn.frames.apply import apply, keeps_every_frame
from tactile_viewgcn.frames.baseline import Baseline, short_empty_hands
from tactile_viewgcn.frames.moments import MIN_FRAMES
from tactile_viewgcn.live.stream import LiveStream
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, listed, several
from tactile_viewgcn.params import on_sensors
from tactile_viewgcn.readers.source import (
    MAX_PRESSURE,
    UNLABELLED,
    Form,
    Recording,
    check_shape,
    storage_type,
)
from tactile_viewgcn.readers.table_columns import table_of
from tactile_viewgcn.recognition.growing import NOT_FINITE, GrowingRecording
from tactile_viewgcn.recognition.model_file import load_classifier
from tactile_viewgcn.recognition.raw_counts import (
    check_layout,
    check_layouts,
    fault_of,
    is_untouched,
    no_contact_note,
    rate_notes,
    short_note,
    untouched_note,
)
from tactile_viewgcn.tables.recordings import (
    NO_SESSION,
    Recordings,
    frames_by_recording,
    in_memory,
)


@dataclass(frozen=True)
class Answer:
    """The answer to a recording.

    Attributes:
        probabilities: float32 (classes,). If no frame is in contact, the class `empty_hand` has
            probability 1; if there is no such class, all classes are equally probable.
        contact: number of frames in contact.
        frames: number of all frames.
        recording: name of the recording.
        object: label of the recording; UNLABELLED if it has none.
    """

    probabilities: np.ndarray
    contact: int = 0
    frames: int = 0
    recording: str = ""
    object: str = UNLABELLED


class _Answered(NamedTuple):
    """An answer, and what there is to say about its recording.

    Attributes:
        answer: the answer.
        fault: why the recording cannot be answered; "" if it can.
        untouched: whether it reads like a hand that touches nothing.
        without_contact: whether no frame is in contact, though the recording is of no empty hand.
    """

    answer: Answer
    fault: str
    untouched: bool
    without_contact: bool


class Recogniser:
    """A trained classifier of recordings.

    Args:
        path: a file that `save_classifier` wrote.

    Attributes:
        classifier: the classifier, ready for answers.
        content: all that the file holds.
        plan: how readings become frames.
        classes: names of the classes.
        shape: (H, W) of a frame.
        system: name of the system, or names of the members of `sensors`.
        calibrated: whether the probabilities are calibrated.

    Raises:
        UserError: the file is no classifier, is damaged or altered, or has an unknown format.
        OSError: the file cannot be opened.
    """

    def __init__(self, path: str | Path):
        self.classifier, self.content = load_classifier(path)
        self.plan = self.content.plan
        self.classes = self.content.classes
        self.shape = self.plan.live.shape
        self.calibrated = self.content.temperature is not None
        model = self.content.model
        self.system: str = model.system
        if on_sensors(model.system):
            self.system = " + ".join(model.members)
        self._layout = (self.shape, self.plan.channel_names)
        # members answer fewer frames as a view set, for which nothing was calibrated
        self._calibrated_from = 0.0
        if self.calibrated:
            self._calibrated_from = getattr(self.classifier, "short", 0.0)

    def answer_recordings(
        self, recordings: Sequence[Recording], empty_hand: Sequence[Recording] = ()
    ) -> tuple[list[Answer], list[Note]]:
        """Return the answers to what `recording_of` returned, and notes; see `answer_table`.

        Args:
            recordings: n recordings without labels.
            empty_hand: recordings of the empty hand in their session. Without them each recording
                counts as a session of its own.
        """
        if not recordings:
            return [], []
        # a fault of the empty hand makes all recordings faulty, so it comes first
        given = [*empty_hand, *recordings]
        check_layouts(given, self._layout)
        is_empty_hand = np.arange(len(given)) < len(empty_hand)
        session = np.arange(len(given))
        if empty_hand:
            session = np.zeros_like(session)
        table = in_memory(
            given,
            [UNLABELLED, EMPTY_HAND],
            is_empty_hand.astype(np.int64),
            session,
            [NO_SESSION] * len(given),
        )
        answers, notes = self.answer_table(replace(table, path=Path()))
        return answers[len(empty_hand) :], notes

    def answer_table(self, recordings: Recordings) -> tuple[list[Answer], list[Note]]:
        """Return the answers to the recordings of a table, and notes.

        The notes are on an empty hand that is not used, on baselines that could not be measured, on
        frame rates, and on recordings that have no contact, read as if the hand touched nothing, or
        are too short for calibrated probabilities.

        Raises:
            UserError: recordings differ from the training set in layout, sensors or scale; the
                message names the first of them.
        """
        check_layout(
            str(recordings.path), (recordings.shape, recordings.channel_names), self._layout
        )
        baseline, contact = apply(self.plan, recordings, new=True)
        answered = [
            self._answer_one(recordings, index, contact[index], baseline)
            for index in frames_by_recording(recordings)
        ]
        unused = self._unused_empty_hand(recordings)
        has_baseline = self.plan.params.baseline != "none"
        _raise_first(recordings, answered, unused if has_baseline else [])
        notes = unused + baseline.notes(recordings, own_open_hand=self.plan.own_open_hand)
        notes += rate_notes(self.plan, recordings)
        notes += self._answer_notes(answered)
        return [one.answer for one in answered], notes

    def _unused_empty_hand(self, recordings: Recordings) -> list[Note]:
        """Return a warning if new recordings bring an empty hand that is not used.

        If the plan subtracts no baseline, an empty hand next to recordings that all have labels is
        one of the objects, and no warning is due.
        """
        if self.plan.params.baseline == "none":
            labels = np.unique(recordings.columns["object"])
            names = {recordings.objects[label] for label in labels}
            if not names >= {EMPTY_HAND, UNLABELLED}:
                return []
            text = "the empty hand is not used, since the training subtracted a constant "
            text += "(preprocess.baseline: none)"
        else:
            short = short_empty_hands(recordings)
            if not short:
                return []
            text = f"the empty hand of a session has fewer than {MIN_FRAMES} frames, so it is not "
            text += f"used: {listed(short)}. Record {MIN_FRAMES} frames or more"
        return [Note(text, "warning", "baseline")]

    def _answer_one(
        self, recordings: Recordings, index: np.ndarray, contact: np.ndarray, baseline: Baseline
    ) -> _Answered:
        """Return the answer to one recording, and what there is to say about the recording.

        Args:
            recordings: the table.
            index: (n,) the frames of the recording.
            contact: bool (n,) which of these are in contact.
            baseline: the baseline of each frame of the table.
        """
        name = recordings.recordings[recordings.columns["recording"][index[0]]]
        label = _label(recordings, index)
        counts = recordings.counts[index]
        excess = counts[contact] - baseline.mean[baseline.of_frame[index[contact]]]
        untouched = False
        if len(excess):
            untouched = is_untouched(self.plan, counts, contact, excess)
        without_contact = not len(excess) and label != EMPTY_HAND
        if untouched:
            contact = np.zeros_like(contact)
            excess = excess[:0]
        with_object = contact & (label != EMPTY_HAND)
        fault = fault_of(self.plan, counts, with_object, excess)
        probabilities = self._probabilities(excess)
        if not fault and not np.isfinite(probabilities).all():
            fault = NOT_FINITE
        answer = Answer(probabilities, len(excess), len(index), name, label)
        return _Answered(answer, fault, untouched, without_contact)

    def _answer_notes(self, answered: list[_Answered]) -> list[Note]:
        """Return notes on recordings without contact, untouched ones, and short ones."""
        total = len(answered)
        without_contact = [one.answer.recording for one in answered if one.without_contact]
        untouched = [one.answer.recording for one in answered if one.untouched]
        short = [
            one.answer.recording
            for one in answered
            if 0 < one.answer.contact < self._calibrated_from
        ]
        notes = list[Note]()
        if without_contact:
            notes.append(no_contact_note(without_contact, total))
        if untouched:
            is_class = EMPTY_HAND in self.classes
            notes.append(untouched_note(self.plan, untouched, total, is_class=is_class))
        if short:
            notes.append(short_note(short, total, self._calibrated_from))
        return notes

    @property
    def separates_grasps(self) -> bool:
        """Return whether a stream knows where a grasp begins and ends, see `live/hand.py`."""
        return not keeps_every_frame(self.plan)

    def stream(self, **options: Any) -> LiveStream:
        """Return a stream that answers frames as they come.

        Args:
            **options: see `LiveStream`.

        Raises:
            UserError: an option is out of its range.
        """
        begin_grasp = partial(GrowingRecording, self.content, self.classifier)
        return LiveStream(self.plan, self.classes, begin_grasp, self._open_hand_fault, **options)

    def _open_hand_fault(self, counts: np.ndarray) -> str:
        """Return what is wrong with a frame (H, W) of the open hand, or "" if nothing is."""
        frames = counts[None]
        return fault_of(self.plan, frames, np.zeros(1, dtype=bool), frames[:0])

    def _probabilities(self, excess: np.ndarray) -> np.ndarray:
        """Return class probabilities float32 (classes,) from counts above baseline.

        Args:
            excess: (n, H, W) counts above baseline of the frames in contact, possibly none.
        """
        if len(excess):
            logarithms = self.content.answer(self.classifier, excess)
            probabilities: np.ndarray = np.exp(logarithms, dtype=np.float32)
            return probabilities
        if EMPTY_HAND in self.classes:
            is_empty = [name == EMPTY_HAND for name in self.classes]
            return np.array(is_empty, dtype=np.float32)
        count = len(self.classes)
        return np.full(count, 1 / count, dtype=np.float32)


def _label(recordings: Recordings, index: np.ndarray) -> str:
    """Return the label of a recording's frames (n,); UNLABELLED if they have several labels."""
    labels: list[int] = np.unique(recordings.columns["object"][index]).tolist()
    if len(labels) > 1:
        return UNLABELLED
    return recordings.objects[labels[0]]


def _place(recordings: Recordings, name: str, total: int) -> str:
    """Return where a recording is: its file, or its place in the source."""
    if recordings.path.is_file() and total == 1:
        return str(recordings.path)
    return str(recordings.path / name)


def _raise_first(recordings: Recordings, answered: list[_Answered], notes: list[Note]) -> None:
    """Raise a UserError with the first recording's fault; do nothing if none has a fault.

    Args:
        recordings: the table.
        answered: the answers to all its recordings.
        notes: what else there is to say of the recordings, which may be the reason; the message
            ends with it.
    """
    faulty = [one for one in answered if one.fault]
    if not faulty:
        return
    place = _place(recordings, faulty[0].answer.recording, len(answered))
    more = ""
    if len(faulty) > 1:
        more = f" and {len(faulty) - 1} more of {several(len(answered), 'recording')}"
    texts = [faulty[0].fault, *(note.text for note in notes)]
    raise UserError(f"{place}{more}: {'; '.join(texts)}")


def recording_of(
    recording: Any, name: str, *, frames_last: bool = False, columns: Sequence[str] = ()
) -> Recording:
    """Return one recording as counts (T, H, W) of the type in which pressure is stored.

    Channels (T, C) become frames of one row. From a DataFrame come the sensors with their names,
    the times, and notes on the other columns.

    Args:
        recording: an array, nested lists, or a DataFrame.
        name: of the recording; messages begin with it.
        frames_last: whether time is the last axis of an array instead of the first.
        columns: which columns of a DataFrame are read, see `Form`.

    Raises:
        UserError: the axes or the type are wrong, there are no frames, or a value does not fit into
            the stored type.
    """
    table = Recording({}, {})
    readings = recording
    if hasattr(recording, "iloc"):  # a DataFrame of pandas
        table = _of_data_frame(recording, name, columns)
        readings = table.values["pressure"]
        frames_last = False
    array = _frames_of(readings, name, frames_last=frames_last)
    if not isinstance(readings, np.ndarray) and _holds_truth_values(readings):
        raise UserError(f"{name} holds true or false; expected integer counts or real numbers")
    dtype = storage_type(array.dtype, name)
    if not len(array):
        raise UserError(f"{name} has no frames; expected one or more")
    _require_fit(array, dtype, name)
    values = table.values | {"pressure": array.astype(dtype, copy=False)}
    return replace(table, names={"recording": name}, values=values)


def _of_data_frame(recording: Any, name: str, columns: Sequence[str]) -> Recording:
    """Return a DataFrame as a recording."""
    names = [str(column) for column in recording.columns]
    cells = recording.set_axis(range(len(names)), axis=1)
    rows = map("row {}".format, recording.index)
    table, _ = table_of(names, cells, Form(columns=columns), name, rows)
    return table


def _frames_of(readings: Any, name: str, *, frames_last: bool) -> np.ndarray:
    """Return readings as an array (T, H, W); raise a UserError if they have other axes."""
    try:
        array = np.asarray(readings)
    except ValueError:
        raise UserError(
            f"{name} is ragged; expected frames of equal size, (frames, rows, columns)"
        ) from None
    if frames_last and array.ndim:
        array = np.moveaxis(array, -1, 0)
    if array.ndim == 1:
        raise UserError(
            f"{name} is a frame {array.shape}; expected recordings (frames, rows, columns), "
            "a single one as [X]"
        )
    if array.ndim == 2:
        array = array[:, None]
    check_shape(array.shape, name)
    return array


def _holds_truth_values(readings: Any) -> bool:
    """Return whether nested lists hold true or false among their numbers."""
    types = set(map(type, np.ravel(np.array(readings, object))))
    return bool(types & {bool, np.bool_})


def _require_fit(array: np.ndarray, dtype: np.dtype, name: str) -> None:
    """Raise a UserError if a number is not finite or does not fit into the stored type."""
    low: float = -MAX_PRESSURE
    high: float = MAX_PRESSURE
    if dtype.kind == "i":
        low = np.iinfo(dtype).min
        high = np.iinfo(dtype).max
    # compared as arrays, since float16 cannot hold these limits
    fits = (array >= np.array(low)) & (array <= np.array(high))
    unfit = np.argwhere(~fits)
    if len(unfit):
        frame, row, column = unfit[0]
        raise UserError(
            f"{name} holds {array[frame, row, column]:g} in frame {frame}, row {row}, "
            f"column {column}; expected numbers from {low:g} to {high:g}"
        )
