"""Checks of what the recordings were preprocessed with: a baseline made of contact, a scale that clips contact."""

import numpy as np

from tactile_viewgcn.frames.baseline import evenly, quiet_frames
from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.params import PreprocessSection
from tactile_viewgcn.tables.frames import Frames

CHECKED_FRAMES = 1000  # of which clipped readings are counted
MOST_CLIPPED = 0.2  # of the readings of sensors in contact


def preprocessing_warnings(inspection: Inspection, frames: Frames, asked: PreprocessSection) -> list[Note]:
    """Warnings of a baseline made of frames in contact, and of a scale that clips much of what sensors in contact read.

    Each names what else could be set for the `frames` made of the recordings; where `auto` chose, that is not `auto`.
    """
    return _baseline_warnings(inspection, frames, asked) + _scale_warnings(inspection, frames, asked)


def _baseline_warnings(inspection: Inspection, frames: Frames, asked: PreprocessSection) -> list[Note]:
    kind = frames.preprocess["baseline"]
    if kind in ("quiet", "grasp") and inspection.all_contact:
        text = (
            f"{kind} is made of frames in contact, as even the quietest are: it is subtracted from the signal; set "
            "preprocess.baseline to auto, which takes the recordings as they are"
        )
        return [Note(text, "warning", "baseline", "preprocess.baseline", "auto")]
    taken = np.array([quiet_frames(count, asked.quiet_share) for count in inspection.frames])
    short = int((inspection.frames - inspection.contact < taken).sum())
    if kind != "quiet" or not short:
        return []
    text = (
        f"quiet is made of frames in contact in {short} of {several(len(taken), 'recording')}, with fewer frames "
        f"without contact than the {taken.min()} or more that it takes; "
    )
    if asked.baseline == "auto":
        return [Note(f"{text}record an open hand first, or lower preprocess.quiet_share", "warning", "baseline")]
    text += "set preprocess.baseline to auto, or lower preprocess.quiet_share"
    return [Note(text, "warning", "baseline", "preprocess.baseline", "auto")]


def _scale_warnings(inspection: Inspection, frames: Frames, asked: PreprocessSection) -> list[Note]:
    if frames.transform != "clip":
        return []
    index = evenly(np.arange(len(frames)), CHECKED_FRAMES)
    excess = frames.inputs(index, "counts")[:, frames.live]
    above = excess[excess > asked.contact_sigmas * inspection.hand.noise[frames.session[index]]]
    if not len(above) or (above > frames.scale).mean() <= MOST_CLIPPED:
        return []
    strongest = float(f"{np.percentile(above, 99):.2g}")
    remedy = "" if asked.scale == "auto" else "auto, or to "
    text = (
        f"{frames.scale:g} clips {100 * (above > frames.scale).mean():.0f} % of what sensors in contact read; set "
        f"preprocess.scale to {remedy}about {strongest:g}"
    )
    return [Note(text, "warning", "scale", "preprocess.scale", strongest)]
