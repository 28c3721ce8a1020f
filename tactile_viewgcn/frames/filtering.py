"""Frames in which the object is held: by STAG's flags, or by contact."""

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import Baseline
from tactile_viewgcn.readers.source import EMPTY_HAND
from tactile_viewgcn.tables.recordings import Recordings


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
    contact = pressed_frames(recordings, baseline, sensors=sensors, sigmas=sigmas)
    if EMPTY_HAND in recordings.objects:
        contact |= recordings.columns["object"] == recordings.objects.index(EMPTY_HAND)
    return contact


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
