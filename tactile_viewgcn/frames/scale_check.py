"""Checks of `preprocess.scale`: it must neither clip contact, nor drown it in the noise that training adds."""

import numpy as np

from tactile_viewgcn.notes import Note
from tactile_viewgcn.params import CONTACT_SIGMAS
from tactile_viewgcn.tables.frames import Frames

MOST_FRAMES = 1000  # whose readings are looked at
MOST_CLIPPED = 0.2  # of the readings of sensors in contact
OF_STRONGEST = 0.1  # of the strongest hundredth of the readings: contact, where the noise of sensors is unknown


def clipping_warnings(frames: Frames, noise: np.ndarray, *, chosen: bool) -> list[Note]:
    """A warning where the scale clips much of what sensors in contact read.

    Args:
        noise: (sessions, S) standard deviation of the live sensors, in counts.
        chosen: `auto` chose the scale, so that it is no remedy.
    """
    if frames.transform != "clip":
        return []
    index, excess = _sample(frames)
    above = excess[excess > CONTACT_SIGMAS * noise[frames.session[index]]]
    if not len(above) or (above > frames.scale).mean() <= MOST_CLIPPED:
        return []
    text = (
        f"{frames.scale:g} clips {100 * (above > frames.scale).mean():.0f} % of what sensors in contact read; set "
        f"preprocess.scale to {'' if chosen else 'auto, or to '}about"
    )
    return [_warning(text, above)]


def noise_warnings(frames: Frames, noise: float) -> list[Note]:
    """A warning where half of what sensors in contact read is below `noise`, which training adds, of full scale."""
    if frames.transform != "clip":
        return []
    excess, of_sensor = _sample(frames)[1], frames.noise[frames.live]
    strongest = float(np.percentile(excess, 99))
    weakest = np.where(np.isnan(of_sensor), OF_STRONGEST * strongest, CONTACT_SIGMAS * of_sensor)
    above = excess[excess > weakest]
    if not len(above) or np.median(above) >= noise * frames.scale:
        return []
    text = (
        f"at {frames.scale:g} the median reading of a sensor in contact, {np.median(above):.3g} counts, is below the "
        f"noise that training adds, {noise * frames.scale:.3g} counts: a network would answer the same for every "
        "object; set preprocess.scale to about"
    )
    return [_warning(text, above)]


def _sample(frames: Frames) -> tuple[np.ndarray, np.ndarray]:
    """Indices (n,) of about 1,000 frames, evenly spaced, and the counts (n, S) of the live sensors above baseline."""
    index = np.unique(np.linspace(0, len(frames) - 1, MOST_FRAMES).astype(int))
    return index, frames.inputs(index, "counts")[:, frames.live]


def _warning(text: str, in_contact: np.ndarray) -> Note:
    """A warning that ends with a better scale, the strongest hundredth of the readings (n,) in contact."""
    scale = float(f"{np.percentile(in_contact, 99):.2g}")
    return Note(f"{text} {scale:g}", "warning", "scale", "preprocess.scale", scale)
