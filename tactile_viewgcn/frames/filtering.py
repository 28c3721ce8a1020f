"""Frames in which the object is held: by STAG's flags, or by contact."""

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import Baseline, of_empty_hand
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.params import Preprocess
from tactile_viewgcn.readers.source import listed
from tactile_viewgcn.tables.recordings import Recordings


def passing(recordings: Recordings, baseline: Baseline, preprocess: Preprocess) -> tuple[np.ndarray, list[Note]]:
    """bool (T,): frames that pass `preprocess.filter`; and notes on those that do not.

    Raises:
        UserError: flags that the recordings do not have, or a baseline without noise.
    """
    if preprocess.filter == "none":
        return np.ones(len(recordings), dtype=bool), []
    if preprocess.filter == "flags":
        return (passed := flagged(recordings)), _notes(recordings, passed, "flags", "a flag")
    sensors, sigmas = preprocess.contact_sensors, preprocess.contact_sigmas
    passed = in_contact(recordings, baseline, sensors=sensors, sigmas=sigmas)
    return passed, _notes(recordings, passed, "contact", f"{several(sensors, 'sensor')} above {sigmas:g} sd")


def flagged(recordings: Recordings) -> np.ndarray:
    """bool (T,): the column `grasp_valid` if the recordings have it, as STAG's set of weights does, else `valid`.

    Raises:
        UserError: they have neither.
    """
    for column in ("grasp_valid", "valid"):
        if column in recordings.columns:
            return recordings.columns[column].copy()
    raise UserError(
        f"{recordings.path}: no validity flags (grasp_valid or valid), which preprocess.filter flags needs: "
        "set it to auto"
    )


def in_contact(recordings: Recordings, baseline: Baseline, *, sensors: int, sigmas: float) -> np.ndarray:
    """bool (T,): frames that `pressed_frames` finds; frames of the empty hand are without contact, and all True.

    Raises:
        UserError: a baseline without noise.
    """
    return pressed_frames(recordings, baseline, sensors=sensors, sigmas=sigmas) | of_empty_hand(recordings)


def pressed_frames(recordings: Recordings, baseline: Baseline, *, sensors: int, sigmas: float) -> np.ndarray:
    """bool (T,): at least `sensors` live sensors read more than `sigmas` standard deviations above their baseline.

    Raises:
        UserError: a baseline without noise.
    """
    if baseline.noise is None:
        raise UserError(
            "preprocess.filter is contact, which needs the baseline's noise: "
            "expected preprocess.filter auto, or preprocess.baseline empty_hand, grasp or quiet"
        )
    contact = np.zeros(len(recordings), dtype=bool)
    threshold = baseline.mean + sigmas * baseline.noise  # (R, H, W)
    for start, counts in recordings.blocks():
        at = slice(start, start + len(counts))
        above = (counts > threshold[baseline.of_frame[at]]) & recordings.live
        contact[at] = above.sum(axis=(1, 2)) >= sensors
    return contact


def _notes(recordings: Recordings, passed: np.ndarray, kind: str, condition: str) -> list[Note]:
    """On frames without the filter's condition, and on recordings and objects without a frame with it."""
    text = f"{kind}: {(~passed).sum():,} of {several(len(passed), 'frame')} dropped, without {condition}"
    notes = [Note(text, topic="filter")]
    for column, names in (("recording", recordings.recordings), ("object", recordings.objects)):
        before, after = np.unique(recordings.columns[column]), recordings.columns[column][passed]
        emptied = [names[i] for i in np.setdiff1d(before, after)]
        text = f"{len(emptied)} of {several(len(before), column)} dropped, no frame has {condition}: {listed(emptied)}"
        if emptied and column == "recording":
            notes.append(Note(text, topic="filter"))
        elif emptied:
            remedy = "lower preprocess.contact_sensors or contact_sigmas, or choose another preprocess.filter"
            notes.append(Note(f"{text}; {remedy}", "warning", "filter"))
    return notes
