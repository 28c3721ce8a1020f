"""Which frames pass `preprocess.filter`: those in contact, or those with a flag of the source."""

import math
from typing import Literal

import numpy as np

from tactile_viewgcn.frames.baseline import Baseline
from tactile_viewgcn.messages import Note, UserError, listed, several
from tactile_viewgcn.params import CONTACT_SIGMAS, PreprocessSection
from tactile_viewgcn.tables.recordings import Recordings

SENSORS_IN_CONTACT = 14  # fewest pressed sensors in a frame of contact, of STAG's 548 sensors
CONTACT_SHARE = 1 / 40  # the same share, for a smaller array
# if more than this share of the recordings has no frame in contact, contact is no filter
MOST_LOST = 0.05
FEW_SENSORS = 16  # a glove of fewer sensors has one or a few on each finger


def sensors_in_contact(live: int) -> int:
    """Return the fewest sensors that are pressed in a frame of contact.

    For STAG's 548 sensors the number is 14. For a smaller array it is a fortieth, but at least two,
    since one sensor can be faulty. Of fewer than 16 sensors an object can press a single one, so
    there one is enough.

    Args:
        live: number of sensors that vary.
    """
    if live < FEW_SENSORS:
        return 1
    return min(SENSORS_IN_CONTACT, max(2, math.ceil(CONTACT_SHARE * live)))


def require_filter(recordings: Recordings, params: PreprocessSection) -> None:
    """Raise a UserError if recordings cannot be filtered as a plan says.

    Args:
        recordings: a table of the training set's source.
        params: the settings of the plan.

    Raises:
        UserError: the filter is `flags`, and there are none; or the filter is `contact`, and there
            is no baseline.
    """
    if params.filter == "flags" and flags_of(recordings) is None:
        raise UserError(
            f"{recordings.path}: no validity flags (grasp_valid or valid), which preprocess.filter "
            "flags needs; set preprocess.filter to auto"
        )
    if params.filter == "contact" and params.baseline == "none":
        raise UserError(
            "preprocess.filter contact needs a baseline, and preprocess.baseline is none; "
            "set preprocess.filter to auto, or preprocess.baseline to empty_hand or grasp"
        )


def passing(
    recordings: Recordings, contact: np.ndarray, params: PreprocessSection
) -> tuple[np.ndarray, list[Note]]:
    """Return the frames that pass `preprocess.filter`, and notes on the other frames.

    Every frame of the empty hand passes the filter `contact`.

    Args:
        recordings: T frames.
        contact: bool (T,), see `apply`.
        params: the settings of the plan.

    Returns:
        The frames that pass, bool (T,), and notes on dropped frames, recordings and objects.
    """
    if params.filter == "none":
        return contact, []
    passed = contact
    condition = "a flag"
    if params.filter == "contact":
        passed = contact | recordings.empty_hand
        sensors = several(int(params.contact_sensors), "sensor")
        condition = f"{sensors} above {CONTACT_SIGMAS:g} standard deviations"
    frames = several(len(passed), "frame")
    dropped = f"dropped {(~passed).sum():,} of {frames}, since they lack {condition}"
    notes = [Note(f"{params.filter}: {dropped}", topic="filter")]
    level: Literal["info", "warning"] = "info"
    if _loses_many_recordings(recordings, passed):
        level = "warning"
    notes += _dropped(recordings, "recording", passed, condition, level)
    notes += _dropped(recordings, "object", passed, condition, "warning")
    return passed, notes


def _loses_many_recordings(recordings: Recordings, passed: np.ndarray) -> bool:
    """Return whether objects that keep frames lose more than a twentieth of all recordings."""
    recording = recordings.columns["recording"]
    of_object = recordings.columns["object"]
    is_kept = np.isin(of_object, of_object[passed])
    lost = np.setdiff1d(recording[is_kept], recording[passed])
    return len(lost) > MOST_LOST * len(np.unique(recording))


def _dropped(
    recordings: Recordings,
    column: Literal["recording", "object"],
    passed: np.ndarray,
    condition: str,
    level: Literal["info", "warning"],
) -> list[Note]:
    """Return a note on the recordings, or the objects, that lose all their frames."""
    names = recordings.recordings
    if column == "object":
        names = recordings.objects
    of_frame = recordings.columns[column]
    emptied = np.setdiff1d(of_frame, of_frame[passed])
    if not len(emptied):
        return []
    count = f"{len(emptied)} of {several(len(np.unique(of_frame)), column)}"
    text = f"dropped {count}, since no frame has {condition}: "
    text += listed([names[i] for i in emptied])
    if column == "recording":
        text += "; they count in no error"
    return [Note(text, level, "filter")]


def flags_of(recordings: Recordings) -> np.ndarray | None:
    """Return a copy of the source's flags that an object is held, bool (T,); None if it has none.

    The flags are the column `grasp_valid` if there is one, as in STAG's set of weights. Otherwise
    they are the column `valid`.
    """
    for column in ("grasp_valid", "valid"):
        if column in recordings.columns:
            return np.array(recordings.columns[column])
    return None


def pressed_frames(recordings: Recordings, baseline: Baseline, sensors: int) -> np.ndarray:
    """Return the frames, bool (T,), in which enough live sensors are pressed.

    A pressed sensor reads more than five standard deviations above its baseline.

    Args:
        recordings: T frames.
        baseline: the baseline of these frames, with known noise.
        sensors: fewest sensors in a frame of contact.
    """
    contact = np.zeros(len(recordings), dtype=bool)
    threshold = baseline.mean + CONTACT_SIGMAS * baseline.noise  # (R, H, W)
    for start, counts in recordings.blocks():
        block = slice(start, start + len(counts))
        above = (counts > threshold[baseline.of_frame[block]]) & recordings.live
        contact[block] = above.sum(axis=(1, 2)) >= sensors
    return contact
