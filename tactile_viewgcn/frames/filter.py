"""Which frames pass `preprocess.filter`: those in contact, or those with a flag of the source."""

import math

import numpy as np

from tactile_viewgcn.frames.baseline import Baseline
from tactile_viewgcn.messages import Note, UserError, listed, several
from tactile_viewgcn.params import CONTACT_SIGMAS, PreprocessSection
from tactile_viewgcn.tables.recordings import Recordings

SENSORS_IN_CONTACT = 14  # fewest in a frame of contact, of STAG's 548
CONTACT_SHARE = 1 / 40  # the same share of a smaller array
FEW_SENSORS = 16  # fewer are one or a few a finger


def sensors_in_contact(live: int) -> int:
    """Fewest sensors that are pressed in a frame of contact: 14 of STAG's 548, a fortieth of a smaller array's.

    They are two at least, since one may be faulty. Of few sensors an object may press a single one:
    one is enough.
    """
    if live < FEW_SENSORS:
        return 1
    return min(SENSORS_IN_CONTACT, max(2, math.ceil(CONTACT_SHARE * live)))


def passing(
    recordings: Recordings, baseline: Baseline, preprocess: PreprocessSection
) -> tuple[np.ndarray, list[Note]]:
    """Frames bool (T,) that pass `preprocess.filter`, and notes on the others; `contact` passes all of the empty hand.

    Raises:
        UserError: flags that the recordings do not have, or a baseline without noise.
    """
    if preprocess.filter == "none":
        return np.ones(len(recordings), dtype=bool), []
    if preprocess.filter == "flags":
        passed, condition = flagged(recordings), "a flag"
    else:
        sensors = int(preprocess.contact_sensors)
        passed = pressed_frames(recordings, baseline, sensors) | recordings.empty_hand
        condition = f"{several(sensors, 'sensor')} above {CONTACT_SIGMAS:g} sd"
    dropped = f"{(~passed).sum():,} of {several(len(passed), 'frame')} dropped, without {condition}"
    notes = [Note(f"{preprocess.filter}: {dropped}", topic="filter")]
    for column, names in (("recording", recordings.recordings), ("object", recordings.objects)):
        of_frame = recordings.columns[column]
        if len(emptied := np.setdiff1d(of_frame, of_frame[passed])):
            count = f"{len(emptied)} of {several(len(np.unique(of_frame)), column)}"
            text = (
                f"{count} dropped, no frame has {condition}: {listed([names[i] for i in emptied])}"
            )
            notes.append(Note(text, "warning" if column == "object" else "info", "filter"))
    return passed, notes


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
    if np.isnan(baseline.noise).any():
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
