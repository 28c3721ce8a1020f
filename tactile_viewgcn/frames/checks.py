"""Checks of what preprocessing has made of the recordings: a warning, with its remedy, where it takes information."""

import numpy as np

from tactile_viewgcn.frames.baseline import quiet_frames
from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.frames.table import Frames
from tactile_viewgcn.params import Preprocess

MOST_FRAMES = 1000  # that are looked at
MOST_CLIPPED = 0.2  # of the readings of sensors in contact
TRAINING_NOISE = 0.015  # of full scale: what both trainings add to the input, see `pretrain.noise`


def preprocessing_warnings(seen: Inspection, frames: Frames, preprocess: Preprocess) -> list[str]:
    """Warnings on baseline and scale.

    Args:
        preprocess: without `auto`.
    """
    warnings = [_baseline_warning(seen, preprocess), _scale_warning(seen, frames, preprocess)]
    return [f"warning: {warning}" for warning in warnings if warning]


def _baseline_warning(seen: Inspection, preprocess: Preprocess) -> str | None:
    """Of a baseline that is the mean of frames in contact."""
    kind = preprocess.baseline
    if kind not in ("quiet", "grasp"):
        return None
    if seen.taken_whole:
        return (
            f"baseline {kind} is made of frames in contact, as even the quietest are: it is subtracted from the "
            "signal; set preprocess.baseline to auto, which takes the recordings as they are"
        )
    taken = np.array([quiet_frames(count, preprocess.quiet_share) for count in seen.frames])
    short = int((seen.frames - seen.contact < taken).sum()) if kind == "quiet" else 0
    if not short:
        return None
    return (
        f"baseline quiet is made of frames in contact in {short} of {len(taken)} recordings, which have fewer frames "
        f"without contact than the {taken.min()} or more that it takes; set preprocess.baseline to auto, or record an "
        "open hand first"
    )


def _scale_warning(seen: Inspection, frames: Frames, preprocess: Preprocess) -> str | None:
    """Of a scale that clips much of what sensors in contact read, or at which it drowns in the noise of training."""
    if preprocess.transform != "clip":
        return None
    scale = float(preprocess.scale)
    index = np.unique(np.linspace(0, len(frames) - 1, MOST_FRAMES).astype(int))
    excess = frames.inputs(index, "counts")
    pressed = (excess > preprocess.contact_sigmas * seen.noise[frames.session[index]]) & frames.live
    above = excess[pressed]
    if not len(above):
        return None
    clipped, typical, strongest = (above > scale).mean(), float(np.median(above)), float(np.percentile(above, 99))
    remedy = f"set preprocess.scale to auto, or to about {strongest:.2g}"
    if clipped > MOST_CLIPPED:
        return f"scale {scale:g} clips {100 * clipped:.0f} % of what sensors in contact read; {remedy}"
    if typical < TRAINING_NOISE * scale:
        noise = f"{TRAINING_NOISE * scale:.3g} counts"
        return (
            f"scale {scale:g} leaves what sensors in contact read, {typical:.3g} counts in the middle, below the noise "
            f"that training adds, {noise}: a network would answer the same for every object; {remedy}"
        )
    return None
