"""Answers to all recordings of a source, whole or in windows of time."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.source import UNLABELLED, Source
from tactile_viewgcn.recognition.answer import Answer, answer_contact
from tactile_viewgcn.recognition.contact import as_table, find_contact
from tactile_viewgcn.recognition.novelty import spread_sets
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.recordings import Recordings


@dataclass(frozen=True)
class Row:
    """The answer to one recording or window.

    Attributes:
        recording: its name.
        object: what the source says is held; UNLABELLED if it does not say.
        start, end: seconds since the recording's first frame; NaN without times.
        frames: all frames.
        latency_ms: from the last frame's arrival to the answer, of frames as they come; NaN of recordings.
    """

    recording: str
    object: str
    start: float
    end: float
    frames: int
    answer: Answer
    latency_ms: float = float("nan")


def answer_source(
    recogniser: Recogniser, source: Source, *, window: float | None = None, stop_at: float | None = None
) -> tuple[list[Row], list[str]]:
    """The answers to the recordings of a source, and notes on what was not as expected.

    Args:
        window: seconds that are answered together; None: whole recordings.
        stop_at: see `answer_recording`.

    Raises:
        UserError: recordings unlike the training's in form or scale, or without the times that windows need; a
            `window` or `stop_at` out of range.
    """
    if window is not None and not (np.isfinite(window) and window > 0):
        raise UserError(f"window is {window:g}; expected seconds above 0")
    if stop_at is not None:
        recogniser.check_sequential(stop_at, "stop_at")
    rows, used = [], []
    with as_table(source, recogniser.preprocessing) as recordings:
        baseline, contact = find_contact(recordings, recogniser.preprocessing)
        for index in _parts(recordings, window):
            held = index[contact[index]]
            excess = recordings.frames(held) - baseline.mean[baseline.of_frame[held]]
            used.append(excess[spread_sets(len(held), recogniser.classifier.views)[0]] if len(held) else excess)
            rows.append(_row(recordings, index, answer_contact(recogniser, excess, stop_at=stop_at)))
    recogniser.preprocessing.check_strength(np.concatenate(used), str(source.path))
    return rows, [str(note) for note in baseline.notes]


def _parts(recordings: Recordings, window: float | None) -> Iterator[np.ndarray]:
    """Indices of the frames that are answered together, in order."""
    recording, time = recordings.columns["recording"], recordings.columns["time"]
    if window is not None and np.isnan(time).any():
        raise UserError("the recordings have no times of their frames, which a window in seconds needs: leave it out")
    for number in np.unique(recording):
        index = np.flatnonzero(recording == number)
        if window is None:
            yield index
            continue
        place = np.floor(time[index] / window)
        for part in np.unique(place):
            yield index[place == part]


def _row(recordings: Recordings, index: np.ndarray, answer: Answer) -> Row:
    columns = recordings.columns
    objects = {recordings.objects[number] for number in np.unique(columns["object"][index])}
    start, end = columns["time"][index[[0, -1]]]
    name = recordings.recordings[columns["recording"][index[0]]]
    return Row(name, objects.pop() if len(objects) == 1 else UNLABELLED, start, end, len(index), answer)
