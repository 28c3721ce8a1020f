"""Frames in which the object is held: by STAG's flags, or by contact."""

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import Baseline, of_empty_hand
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.params import CONTACT_SIGMAS, PreprocessSection
from tactile_viewgcn.readers.source import listed
from tactile_viewgcn.tables.recordings import Recordings


def passing(recordings: Recordings, baseline: Baseline, preprocess: PreprocessSection) -> tuple[np.ndarray, list[Note]]:
    """bool (T,): frames that pass `preprocess.filter`, of `contact` all of the empty hand; and notes on the others.

    Raises:
        UserError: flags that the recordings do not have, or a baseline without noise.
    """
    if preprocess.filter == "none":
        return np.ones(len(recordings), dtype=bool), []
    if preprocess.filter == "flags":
        return (passed := flagged(recordings)), _notes(recordings, passed, "flags", "a flag")
    sensors = int(preprocess.contact_sensors)
    passed = pressed_frames(recordings, baseline, sensors) | of_empty_hand(recordings)
    return passed, _notes(recordings, passed, "contact", f"{several(sensors, 'sensor')} above {CONTACT_SIGMAS:g} sd")


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


def pressed_frames(recordings: Recordings, baseline: Baseline, sensors: int) -> np.ndarray:
    """bool (T,): at least `sensors` live sensors read more than five standard deviations above their baseline.

    Raises:
        UserError: a baseline without noise.
    """
    if baseline.noise is None:
        raise UserError(
            "preprocess.filter is contact, which needs the baseline's noise: "
            "expected preprocess.filter auto, or preprocess.baseline empty_hand or grasp"
        )
    contact = np.zeros(len(recordings), dtype=bool)
    threshold = baseline.mean + CONTACT_SIGMAS * baseline.noise  # (R, H, W)
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
            remedy = "lower preprocess.contact_sensors, or choose another preprocess.filter"
            notes.append(Note(f"{text}; {remedy}", "warning", "filter"))
    return notes
