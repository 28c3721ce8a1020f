"""Checks of what the recordings were preprocessed with: a baseline made of contact, a scale that clips contact."""

import numpy as np

from tactile_viewgcn.frames.baseline import evenly
from tactile_viewgcn.frames.open_hand import OpenHand
from tactile_viewgcn.notes import Note
from tactile_viewgcn.params import CONTACT_SIGMAS, PreprocessSection
from tactile_viewgcn.tables.frames import Frames

CHECKED_FRAMES = 1000  # in which clipped readings are counted
MOST_CLIPPED = 0.2  # of the readings of sensors in contact


def preprocessing_warnings(hand: OpenHand, frames: Frames, asked: PreprocessSection) -> list[Note]:
    """Warnings of a baseline made of frames in contact, and of a scale that clips much of what sensors in contact read.

    Each names a better value for the `frames` of the recordings; where `auto` chose, that is not `auto`.
    """
    warnings = []
    if frames.preprocess["baseline"] == "grasp" and hand.all_contact:
        text = (
            "grasp is made of frames in contact, as even the quietest are: it is subtracted from the signal; set "
            "preprocess.baseline to auto, which takes the recordings as they are"
        )
        warnings.append(Note(text, "warning", "baseline", "preprocess.baseline", "auto"))
    if frames.transform != "clip":
        return warnings
    index = evenly(np.arange(len(frames)), CHECKED_FRAMES)
    excess = frames.inputs(index, "counts")[:, frames.live]
    above = excess[excess > CONTACT_SIGMAS * hand.noise[frames.session[index]]]
    if len(above) and (above > frames.scale).mean() > MOST_CLIPPED:
        strongest = float(f"{np.percentile(above, 99):.2g}")
        remedy = "" if asked.scale == "auto" else "auto, or to "
        text = (
            f"{frames.scale:g} clips {100 * (above > frames.scale).mean():.0f} % of what sensors in contact read; set "
            f"preprocess.scale to {remedy}about {strongest:g}"
        )
        warnings.append(Note(text, "warning", "scale", "preprocess.scale", strongest))
    return warnings
