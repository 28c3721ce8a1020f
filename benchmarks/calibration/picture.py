"""Frames drawn on the hand: what the glove feels of a coin, a mug, a ball and nothing."""

import numpy as np
from matplotlib.figure import Figure

from benchmarks.calibration.frame_statistics import Excess
from tactile_viewgcn.glove.hand import Hands, stag_hand
from tactile_viewgcn.readers.source import EMPTY_HAND

DRAWN, EACH = ("coin", "mug", "ball", EMPTY_HAND), 3  # objects, and recordings of each
MAX_EXCESS = 30  # counts above the baseline at the end of the colour scale


def frames_on_hand(excess: Excess) -> Figure:
    """The frame of the largest sum in three recordings of each of DRAWN, counts above the baseline, on a flat hand."""
    hand = stag_hand()
    pose = Hands([hand]).pose(np.zeros(1, dtype=int), np.zeros((1, 5, 2)), np.zeros(1))
    x, y, _ = (pose.origin[0, hand.patch] + np.einsum("sij,sj->si", pose.axes[0, hand.patch], hand.local)).T
    frames = np.zeros((len(excess.values), *excess.sensors.shape), dtype=np.float32)
    frames[:, excess.sensors] = excess.values
    frames = np.clip(frames[:, hand.row, hand.column], 0, MAX_EXCESS)
    figure = Figure(figsize=(3 * EACH, 3.1 * len(DRAWN)), dpi=90, layout="constrained")
    panels = figure.subplots(len(DRAWN), EACH)
    for line, name in zip(panels, DRAWN, strict=True):
        chosen = (excess.object == excess.objects.index(name)) & (excess.held | excess.empty)
        for panel, number in zip(line, np.unique(excess.recording[chosen]), strict=False):
            recording = frames[chosen & (excess.recording == number)]
            busiest = recording[recording.sum(axis=1).argmax()]
            dots = panel.scatter(y, x, 5 + 2 * busiest, busiest, cmap="YlOrRd", vmin=0, vmax=MAX_EXCESS)
            panel.set(aspect="equal", xticks=[], yticks=[], title=name.replace("_", " "), facecolor="0.8")
    figure.colorbar(dots, ax=panels, label="counts above the baseline (simulated)", shrink=0.4)
    return figure
