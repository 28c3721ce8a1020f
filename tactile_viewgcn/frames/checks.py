"""Checks of what preprocessing has made of the recordings: a warning, with its remedy, where it takes information."""

import numpy as np

from tactile_viewgcn.frames.baseline import quiet_frames
from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.frames.noise_check import two_digits
from tactile_viewgcn.params import PreprocessSection
from tactile_viewgcn.tables.frames import Frames

MOST_FRAMES = 1000  # that are looked at
MOST_CLIPPED = 0.2  # of the readings of sensors in contact


def preprocessing_warnings(seen: Inspection, frames: Frames, asked: PreprocessSection) -> list[str]:
    """Warnings on baseline and scale, each with what else could be set; where `auto` chose, that is not `auto`.

    `frames` is what was made of the recordings.
    """
    warnings = [_baseline_warning(seen, frames, asked), _scale_warning(seen, frames, asked)]
    return [f"warning: {warning}" for warning in warnings if warning]


def _baseline_warning(seen: Inspection, frames: Frames, asked: PreprocessSection) -> str | None:
    """Of a baseline that is the mean of frames in contact."""
    kind = frames.preprocess["baseline"]
    if kind not in ("quiet", "grasp"):
        return None
    if seen.all_contact:
        return (
            f"baseline {kind} is made of frames in contact, as even the quietest are: it is subtracted from the "
            "signal; set preprocess.baseline to auto, which takes the recordings as they are"
        )
    taken = np.array([quiet_frames(count, asked.quiet_share) for count in seen.frames])
    short = int((seen.frames - seen.contact < taken).sum()) if kind == "quiet" else 0
    if not short:
        return None
    remedy = "record an open hand first" if asked.baseline == "auto" else "set preprocess.baseline to auto"
    return (
        f"baseline quiet is made of frames in contact in {short} of {len(taken)} recordings, which have fewer frames "
        f"without contact than the {taken.min()} or more that it takes; {remedy}, or lower preprocess.quiet_share"
    )


def _scale_warning(seen: Inspection, frames: Frames, asked: PreprocessSection) -> str | None:
    """Of a scale that clips much of what sensors in contact read."""
    if frames.transform != "clip":
        return None
    index = np.unique(np.linspace(0, len(frames) - 1, MOST_FRAMES).astype(int))
    excess = frames.inputs(index, "counts")
    pressed = (excess > asked.contact_sigmas * seen.noise[frames.session[index]]) & frames.live
    above = excess[pressed]
    if not len(above):
        return None
    clipped = (above > frames.scale).mean()
    if clipped <= MOST_CLIPPED:
        return None
    strongest = f"about {two_digits(np.percentile(above, 99))}"
    remedy = f"set preprocess.scale to {strongest if asked.scale == 'auto' else f'auto, or to {strongest}'}"
    return f"scale {frames.scale:g} clips {100 * clipped:.0f} % of what sensors in contact read; {remedy}"
