"""The trained recogniser: the object in the hand, from the raw counts of one recording or of a table of recordings."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.files import readable
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, several
from tactile_viewgcn.params import on_sensors
from tactile_viewgcn.readers.source import (
    MAX_PRESSURE,
    UNLABELLED,
    Form,
    Recording,
    check_shape,
    storage_type,
)
from tactile_viewgcn.readers.text import table_of
from tactile_viewgcn.recognition.model_file import UNFIT, load_classifier
from tactile_viewgcn.recognition.raw_counts import (
    check_layout,
    check_layouts,
    fault_of,
    find_contact,
    is_untouched,
    rate_notes,
    untouched_note,
)
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording, in_memory


@dataclass(frozen=True)
class Answer:
    """The object in a recording.

    Attributes:
        probabilities: float32 (classes,). Without a frame in contact it is the class `empty_hand`,
            or where there is none, all are equally probable.
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
        self._layout = self.shape, self.preprocessing.channel_names
        # few frames: maybe off scale
        with readable(path, *UNFIT), suppress(UserError), np.errstate(all="ignore"):
            self.answer_recordings(
                [recording_of(each, "example") for each in self.content.examples]
            )

    def answer_recordings(self, recordings: Sequence[Recording]) -> tuple[list[Answer], list[Note]]:
        """The answers to recordings of `recording_of`, each from its frames alone; see `answer_table`."""
        if not recordings:
            return [], []
        check_layouts(recordings, self._layout)
        table = in_memory(recordings, [UNLABELLED], np.zeros(len(recordings), dtype=np.int64))
        return self.answer_table(replace(table, path=Path()))

    def answer_table(self, recordings: Recordings) -> tuple[list[Answer], list[Note]]:
        """The answers to the recordings of a table; and notes.

        They are on baselines that could not be measured, on rates, and on recordings that read as
        untouched.

        Raises:
            UserError: recordings unlike the training's in layout, sensors or scale; it names the
                first.
        """
        fitted, columns, path = self.preprocessing, recordings.columns, recordings.path
        check_layout(str(path), (recordings.shape, recordings.channel_names), self._layout)
        notes = rate_notes(fitted, recordings)
        recordings = replace(recordings, live=fitted.live)
        baseline, contact = find_contact(fitted, recordings)
        empty = np.array([name == EMPTY_HAND for name in self.classes], dtype=np.float32)
        answers, faults, index_of = (
            list[Answer](),
            dict[str, str](),
            frames_by_recording(recordings),
        )
        untouched = list[str]()
        for index in index_of:
            name = recordings.recordings[columns["recording"][index[0]]]
            pressed = index[contact[index]]
            excess = recordings.counts[pressed] - baseline.mean[baseline.of_frame[pressed]]
            if len(pressed) and is_untouched(
                fitted, recordings.counts[index], contact[index], excess
            ):
                untouched.append(name)
                contact[index] = False
                excess = excess[:0]
            names = {recordings.objects[number] for number in columns["object"][index]}
            label = names.pop() if len(names) == 1 else UNLABELLED
            in_contact = contact[index] & (label != EMPTY_HAND)
            fault = fault_of(fitted, recordings.counts[index], in_contact, excess)
            shares = empty if empty.any() else np.full(len(empty), 1 / len(empty), dtype=np.float32)
            if len(excess):
                shares = np.exp(self.content.answer(self.classifier, excess), dtype=np.float32)
            if not np.isfinite(shares).all():
                fault = (
                    fault
                    or "the model's answer is not finite; expected probabilities: train it again"
                )
            if fault:
                faults[str(path if path.is_file() and len(index_of) == 1 else path / name)] = fault
            answers.append(Answer(shares, len(excess), len(index), name, label))
        if faults:
            place, fault = next(iter(faults.items()))
            more = (
                f" and {len(faults) - 1} more of {several(len(index_of), 'recording')}"
                if len(faults) > 1
                else ""
            )
            raise UserError(f"{place}{more}: {fault}")
        if untouched:
            notes.append(
                untouched_note(fitted, untouched, len(index_of), is_class=bool(empty.any()))
            )
        return answers, baseline.notes + notes


def recording_of(
    recording: Any, name: str, *, frames_last: bool = False, columns: Sequence[str] = ()
) -> Recording:
    """One recording as counts (T, H, W) of the type in which pressure is stored; channels (T, C) as frames of one row.

    Of a DataFrame it is the sensors, with their names, the times, and notes on the other columns.

    Args:
        frames_last: time is the last axis of an array instead of the first.
        columns: of DataFrames, see `Form`.

    Raises:
        UserError: begins with `name`; other axes or types, no frames, or values that the type
            cannot hold.
    """
    table = Recording({}, {})
    if hasattr(recording, "iloc"):  # a DataFrame of pandas
        names = [str(column) for column in recording.columns]
        cells = recording.set_axis(range(len(names)), axis=1)
        table, _ = table_of(
            names, cells, Form(columns=columns), name, map("row {}".format, recording.index)
        )
        recording, frames_last = table.values["pressure"], False
    try:
        array = np.asarray(recording)
    except ValueError:
        raise UserError(
            f"{name} is ragged; expected frames of equal size, (frames, rows, columns)"
        ) from None
    if frames_last and array.ndim:
        array = np.moveaxis(array, -1, 0)
    if array.ndim == 1:
        raise UserError(
            f"{name} is a frame {array.shape}; expected recordings (frames, rows, columns), one alone as [X]"
        )
    array = array[:, None] if array.ndim == 2 else array
    check_shape(array.shape, name)
    if not isinstance(recording, np.ndarray) and {bool, np.bool_} & {
        *map(type, np.ravel(np.array(recording, object)))
    }:
        raise UserError(f"{name} holds true or false; expected integer counts or real numbers")
    dtype = storage_type(array.dtype, name)
    if not len(array):
        raise UserError(f"{name} has no frames; expected one or more")
    low, high = (
        (np.iinfo(dtype).min, np.iinfo(dtype).max)
        if dtype.kind == "i"
        else (-MAX_PRESSURE, MAX_PRESSURE)
    )
    # arrays: float16 has no such number
    unfit = np.argwhere(~((array >= np.array(low)) & (array <= np.array(high))))
    if len(unfit):
        place = "frame {}, row {}, column {}".format(*unfit[0])
        raise UserError(
            f"{name} holds {array[tuple(unfit[0])]:g} in {place}; expected numbers from {low:g} to {high:g}"
        )
    values = table.values | {"pressure": array.astype(dtype, copy=False)}
    return replace(table, names={"recording": name}, values=values)
