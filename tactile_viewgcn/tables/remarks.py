"""Warnings of what spoils a result whatever is computed from a table of raw counts, for `ingest` and `inspect`."""

import hashlib

import numpy as np

from tactile_viewgcn.messages import Note, listed, several
from tactile_viewgcn.tables.frames import sensor_names
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

FEWEST = 20  # steps that show a ramp
STRAIGHT = 0.999  # correlation with the frame's number
SLOW = 1.0  # median seconds between frames; those of a clock in milliseconds are more


def remarks(recordings: Recordings, original: np.ndarray) -> list[Note]:
    """The reader's notes, and warnings of recordings without frames, copies, labels, ramps and times.

    Args:
        original: see `originals`.
    """
    return [
        *recordings.notes,
        *without_frames(recordings),
        *_copies(recordings, original),
        *_labels(recordings),
        *_ramps(recordings),
        *_times(recordings),
    ]


def without_frames(recordings: Recordings) -> list[Note]:
    """A warning that names recordings without frames, and objects of which there is no frame."""
    names, objects = (
        [name for number, name in enumerate(names) if number not in used]
        for names, used in (
            (recordings.recordings, set(recordings.columns["recording"])),
            (recordings.objects, set(recordings.columns["object"])),
        )
    )
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


def _copies(recordings: Recordings, original: np.ndarray) -> list[Note]:
    names = recordings.recordings
    copies = np.flatnonzero(original != np.arange(len(original)))
    if not len(copies):
        return []
    pairs = listed([f"{names[copy]} repeats {names[original[copy]]}" for copy in copies])
    text = f"{several(len(copies), 'recording')} with the counts of a different one: {pairs}. A copy tests nothing, "
    return [Note(f"{text}and as a different object it is wrong: remove it, or record it again.", "warning", "copies")]


def _labels(recordings: Recordings) -> list[Note]:
    """A warning of sensors that read one number for each object, and not the same for all."""
    first, labels = dict[int, np.ndarray](), recordings.live.copy()
    for index in frames_by_recording(recordings):
        counts = recordings.counts[index]
        expected = first.setdefault(int(recordings.columns["object"][index[0]]), counts[0])
        labels &= (counts == expected).all(axis=0)
    if not labels.any() or len(first) < 2:
        return []
    text = _listed_sensors(recordings, labels, "with one reading for each object")
    remedy = "Names of objects are no readings: remove them, or call the column `object`."
    return [Note(f"{text}. {remedy}", "warning", "labels")]


def _listed_sensors(recordings: Recordings, sensors: np.ndarray, what: str) -> str:
    """`2 sensors WHAT: ...`, with the names of some sensors, bool (H, W)."""
    names = sensor_names(sensors, recordings.channel_names)
    return f"{several(len(names), 'sensor')} {what}: {listed(names, '; ')}"


def _ramps(recordings: Recordings) -> list[Note]:
    """A warning of sensors whose readings are a straight line over time in every recording, as those of a clock are."""
    ramps, count = recordings.live.copy(), 0
    for index in frames_by_recording(recordings):
        place = np.arange(len(index)) - (len(index) - 1) / 2
        counts = recordings.counts[index][:, ramps].astype(np.float64)
        counts -= counts.mean(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):  # of sensors that do not vary
            straight = np.abs(place @ counts) / np.sqrt((place**2).sum() * (counts**2).sum(axis=0)) > STRAIGHT
        ramps[ramps], count = straight, count + len(index) - 1
    if not ramps.any() or count < FEWEST:
        return []
    text = _listed_sensors(recordings, ramps, "rising or falling evenly in every recording")
    remedy = "Remove a clock: by it alone recordings can be told from earlier ones."
    return [Note(f"{text}. {remedy}", "warning", "ramps")]


def _times(recordings: Recordings) -> list[Note]:
    """Warnings of times that do not rise from frame to frame, and of those that may be in milliseconds."""
    order = np.concatenate(frames_by_recording(recordings))
    number, time = (recordings.columns[name][order] for name in ("recording", "time"))
    steps, within = np.diff(time), number[1:] == number[:-1]
    bad, notes = within & (steps <= 0), []
    if bad.any():
        first = recordings.recordings[number[bad.argmax()]]
        places = f"{several(int(bad.sum()), 'place')}, first in {first}"
        text = f"Times repeat or fall at {places}. Look at the clock of the program that records."
        notes.append(Note(text, "warning", "time"))
    if (rising := steps[within & (steps > 0)]).size and (step := np.median(rising)) >= SLOW:
        text = f"A frame every {step:.3g} s: times are in seconds. Divide them by 1,000 if they are milliseconds."
        notes.append(Note(text, "warning", "time"))
    return notes
