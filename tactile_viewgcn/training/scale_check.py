"""Checks of `preprocess.scale`: it must neither clip contact, nor drown it in the noise that training adds."""

import numpy as np

from tactile_viewgcn.messages import Note
from tactile_viewgcn.params import CONTACT_SIGMAS
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.frames import TRAIN, Frames

MOST_FRAMES = 1000  # whose readings are compared with the scale
MOST_CLIPPED = 0.2  # of the readings of sensors in contact
OF_STRONGEST = 0.1  # of the strongest hundredth of the readings: contact, where the noise of sensors is unknown


def scale_warnings(frames: Frames, noise: float) -> list[Note]:
    """Warnings of a scale that spoils a network's input, each with a better scale.

    It clips more than a fifth of the readings of sensors in contact, or their median is below the noise that training
    adds.

    Args:
        noise: standard deviation of that noise, relative to the scale.
    """
    if frames.transform != "clip":
        return []
    excess = frames.inputs(evenly(frames.on(TRAIN), MOST_FRAMES), "counts")[:, frames.live]
    of_sensor, strongest = frames.noise[frames.live], np.percentile(excess, 99)
    weakest = np.where(np.isnan(of_sensor), OF_STRONGEST * strongest, CONTACT_SIGMAS * of_sensor)
    in_contact = excess[excess > weakest]
    if not len(in_contact):
        return []
    clipped, median, texts = (in_contact > frames.scale).mean(), np.median(in_contact), []
    if clipped > MOST_CLIPPED:
        texts.append(f"{frames.scale:g} clips {100 * clipped:.0f} % of the readings of sensors in contact")
    if median < noise * frames.scale:
        texts.append(
            f"at {frames.scale:g} the median reading of a sensor in contact, {median:.3g}, is below the noise that "
            f"training adds, {noise * frames.scale:.3g}: a network would answer the same for every object"
        )
    better = float(f"{np.percentile(in_contact, 99):.2g}")
    remedy = f"; set preprocess.scale to about {better:g}"
    return [Note(text + remedy, "warning", "scale", "preprocess.scale", better) for text in texts]
