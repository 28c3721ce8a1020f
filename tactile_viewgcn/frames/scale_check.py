"""Checks of `preprocess.scale`: it must neither clip contact, nor drown it in the noise that training adds."""

import numpy as np

from tactile_viewgcn.messages import Note
from tactile_viewgcn.params import CONTACT_SIGMAS
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.frames import TRAIN, Frames

MOST_FRAMES = 1000  # whose readings are compared with the scale
MOST_CLIPPED = 0.2  # of the readings of sensors in contact
OF_STRONGEST = 0.1  # of the strongest hundredth of the readings: contact, where the noise of sensors is unknown


def clipping_warnings(frames: Frames, noise: np.ndarray) -> list[Note]:
    """A warning where the scale clips more than a fifth of the readings of sensors in contact.

    Args:
        noise: (sessions, S) standard deviation of the live sensors, in counts.
    """
    index, excess = _sample(frames)
    above = excess[excess > CONTACT_SIGMAS * noise[frames.session[index]]]
    clipped = above > frames.scale
    if frames.transform != "clip" or not len(above) or clipped.mean() <= MOST_CLIPPED:
        return []
    share = f"{100 * clipped.mean():.0f} %"
    return [_warning(f"{frames.scale:g} clips {share} of the readings of sensors in contact", above)]


def noise_warnings(frames: Frames, noise: float) -> list[Note]:
    """A warning where the median reading of a sensor in contact is below the noise that training adds.

    Args:
        noise: its standard deviation, relative to the scale.
    """
    excess, of_sensor = _sample(frames)[1], frames.noise[frames.live]
    strongest = float(np.percentile(excess, 99))
    weakest = np.where(np.isnan(of_sensor), OF_STRONGEST * strongest, CONTACT_SIGMAS * of_sensor)
    above = excess[excess > weakest]
    if frames.transform != "clip" or not len(above) or np.median(above) >= noise * frames.scale:
        return []
    text = (
        f"at {frames.scale:g} the median reading of a sensor in contact, {np.median(above):.3g}, is below the "
        f"noise that training adds, {noise * frames.scale:.3g}: a network would answer the same for every object"
    )
    return [_warning(text, above)]


def _sample(frames: Frames) -> tuple[np.ndarray, np.ndarray]:
    """Indices (n,) of about 1,000 training frames, and the counts (n, S) of their live sensors above baseline."""
    index = evenly(frames.on(TRAIN), MOST_FRAMES)
    return index, frames.inputs(index, "counts")[:, frames.live]


def _warning(text: str, in_contact: np.ndarray) -> Note:
    """A warning that ends with a better scale, the strongest hundredth of the readings (n,) in contact."""
    scale = float(f"{np.percentile(in_contact, 99):.2g}")
    return Note(f"{text}; set preprocess.scale to about {scale:g}", "warning", "scale", "preprocess.scale", scale)
