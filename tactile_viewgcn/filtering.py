"""Which frames show the object: by STAG's flags, or by contact."""

import numpy as np

from tactile_viewgcn.baseline import Rest
from tactile_viewgcn.recordings import EMPTY_HAND, Recordings


def flagged(recordings: Recordings) -> np.ndarray:
    """bool (T,): graspValid where the data has it (STAG's `weights`), else hasValidLabel.

    Raises:
        ValueError: the recordings carry neither.
    """
    for column in ("grasp_valid", "valid"):
        if column in recordings.columns:
            return recordings.columns[column].copy()
    raise ValueError(f"{recordings.path}: no validity flags; preprocess.filter flags needs them: set it to contact")


def in_contact(recordings: Recordings, rest: Rest, *, sensors: int, sigmas: float) -> np.ndarray:
    """bool (T,): at least `sensors` live sensors above `sigmas` standard deviations of their own rest noise.

    Frames of the empty hand touch nothing and are always kept.
    """
    touching = np.zeros(len(recordings), dtype=bool)
    threshold = rest.mean + sigmas * rest.noise  # (R, H, W)
    for start, counts in recordings.blocks():
        at = slice(start, start + len(counts))
        above = (counts > threshold[rest.of_frame[at]]) & recordings.live
        touching[at] = above.sum(axis=(1, 2)) >= sensors
    if EMPTY_HAND in recordings.objects:
        touching |= recordings.columns["object"] == recordings.objects.index(EMPTY_HAND)
    return touching
