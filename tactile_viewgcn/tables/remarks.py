"""Warnings of what spoils a result whatever is computed from a table of raw counts, for `ingest` and `inspect`."""

import hashlib
import re
import unicodedata
from collections.abc import Iterator

import numpy as np

from tactile_viewgcn.messages import Note, listed, several
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording


def remarks(recordings: Recordings, original: np.ndarray) -> list[Note]:
    """The reader's notes, and warnings of recordings without frames, copies, spellings and times.

    Args:
        original: see `originals`.
    """
    warnings = [*_copies(recordings, original), *_spellings(recordings), *_times(recordings)]
    return [
        *recordings.notes,
        *without_frames(recordings),
        *(Note(text, "warning", topic) for topic, text in warnings),
    ]


def without_frames(recordings: Recordings) -> list[Note]:
    """A warning that names recordings without frames, and objects of which there is no frame."""
    recorded, with_frames = (set(recordings.columns[name]) for name in ("recording", "object"))
    names = [name for number, name in enumerate(recordings.recordings) if number not in recorded]
    objects = [name for number, name in enumerate(recordings.objects) if number not in with_frames]
    text = f"{several(len(names), 'recording')} without frames: {listed(names)}. " if names else ""
    text += f"No frame of the objects {listed(objects)}. " if objects else ""
    return [Note(f"{text}Record them again, or remove them.", "warning", "no frames")] if text else []


def originals(recordings: Recordings) -> np.ndarray:
    """For each recording (R,) the number of the first one of the same counts, frame by frame: mostly its own."""
    original, first = np.arange(len(recordings.recordings)), dict[bytes, int]()
    for index in frames_by_recording(recordings):
        number, counts = recordings.columns["recording"][index[0]], recordings.counts[index]
        original[number] = first.setdefault(hashlib.sha256(counts.tobytes()).digest(), number)
    return original


def _copies(recordings: Recordings, original: np.ndarray) -> Iterator[tuple[str, str]]:
    names = recordings.recordings
    if pairs := [f"{names[copy]} repeats {names[first]}" for copy, first in enumerate(original) if copy != first]:
        text = f"{several(len(pairs), 'recording')} with the counts of a different one: {listed(pairs)}. A copy tests "
        yield "copies", f"{text}nothing, and as a different object it is wrong: remove it, or record it again."


def _spellings(recordings: Recordings) -> Iterator[tuple[str, str]]:
    """A warning of objects whose names differ in capitals, blanks, hyphens or underscores alone."""
    labels = [recordings.columns["object"][index[0]] for index in frames_by_recording(recordings)]
    counts, alike = np.bincount(labels, minlength=len(recordings.objects)), dict[str, list[str]]()
    for name, count in zip(recordings.objects, counts.tolist(), strict=True):
        key = re.sub(r"(?<=\w)[\s_-]+", "", unicodedata.normalize("NFKC", name)).casefold()
        alike.setdefault(key, []).append(f"{name!r} ({several(count, 'recording')})")
    if names := [" and ".join(spelt) for spelt in alike.values() if len(spelt) > 1]:
        yield "spelling", f"Objects whose names differ in spelling alone: {listed(names)}. If one is meant, rename it."


def _times(recordings: Recordings) -> Iterator[tuple[str, str]]:
    """A warning of times that do not rise from frame to frame."""
    order = np.concatenate(frames_by_recording(recordings))
    number, time = (recordings.columns[name][order] for name in ("recording", "time"))
    steps, within = np.diff(time), number[1:] == number[:-1]
    if (bad := within & (steps <= 0)).any():
        places = f"{several(int(bad.sum()), 'place')}, first in {recordings.recordings[number[bad.argmax()]]}"
        yield "time", f"Times repeat or fall at {places}. Look at the clock of the program that records."
