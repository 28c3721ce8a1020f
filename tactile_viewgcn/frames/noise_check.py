"""Check of what a network is trained on: readings below the noise that training adds teach it nothing."""

import numpy as np

from tactile_viewgcn.notes import Note
from tactile_viewgcn.params import CONTACT_SIGMAS
from tactile_viewgcn.tables.frames import Frames

MOST_FRAMES = 1000  # that are looked at
OF_STRONGEST = 0.1  # of the strongest hundredth of the readings: contact, where the noise of sensors is unknown


def noise_warnings(frames: Frames, noise: float) -> list[Note]:
    """A warning where half of what sensors in contact read is below `noise`, which training adds, of full scale."""
    if frames.transform != "clip":
        return []
    index = np.unique(np.linspace(0, len(frames) - 1, MOST_FRAMES).astype(int))
    excess, of_sensor = frames.inputs(index, "counts")[:, frames.live], frames.noise[frames.live]
    strongest = float(np.percentile(excess, 99))
    weakest = np.where(np.isnan(of_sensor), OF_STRONGEST * strongest, CONTACT_SIGMAS * of_sensor)
    above = excess[excess > weakest]
    if not len(above) or np.median(above) >= noise * frames.scale:
        return []
    scale = float(f"{np.percentile(above, 99):.2g}")
    text = (
        f"at {frames.scale:g} the median reading of a sensor in contact, {np.median(above):.3g} counts, is below the "
        f"noise that training adds, {noise * frames.scale:.3g} counts: a network would answer the same for every "
        f"object; set preprocess.scale to about {scale:g}"
    )
    return [Note(text, "warning", "scale", "preprocess.scale", scale)]
