"""Frames drawn on the hand: what the glove feels of a coin, a mug, a ball and nothing."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from tactile_viewgcn.glove.hand import Hands, stag_hand
from tactile_viewgcn.source import open_source

DRAWN, EACH = ("coin", "mug", "ball", "empty_hand"), 3
MOST = 30  # counts above rest at the end of the colour scale


def frames_on_hand(path: Path) -> Figure:
    """The busiest held frame of three recordings of each of DRAWN; counts above rest."""
    source = open_source(path)
    blocks = list(source.blocks)
    counts, thing, recording, valid = (
        np.concatenate([block[name] for block in blocks]) for name in ("pressure", "object", "recording", "valid")
    )
    rest = np.median(counts[thing == source.objects.index("empty_hand")], axis=0)
    place, row, column = layout()
    figure = Figure(figsize=(3 * EACH, 3.1 * len(DRAWN)), layout="constrained")
    panels = figure.subplots(len(DRAWN), EACH)
    for line, name in zip(panels, DRAWN, strict=True):
        own = np.flatnonzero((thing == source.objects.index(name)) & (valid == 1))
        chosen = [own[recording[own] == one] for one in np.unique(recording[own])[:EACH]]
        for panel, frames in zip(line, chosen, strict=True):
            excess = np.clip(counts[frames] - rest, 0, MOST)[:, row, column]
            busiest = excess[excess.sum(axis=1).argmax()]
            size = 5 + 2 * busiest
            dots = panel.scatter(place[:, 1], place[:, 0], c=busiest, s=size, cmap="YlOrRd", vmin=0, vmax=MOST)
            panel.set(aspect="equal", xticks=[], yticks=[], title=name.replace("_", " "))
            panel.set_facecolor("0.8")
    figure.colorbar(dots, ax=panels, label="counts above rest (simulated)", shrink=0.4)
    return figure


def layout() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where each sensor lies (S, 2) m, x along the fingers and y across, on a flat hand; its row and its column."""
    hand = stag_hand()
    pose = Hands([hand]).pose(np.zeros(1, dtype=int), np.zeros((1, 5, 2)), np.zeros(1))
    flat = pose.origin[0, hand.patch] + np.einsum("sij,sj->si", pose.axes[0, hand.patch], hand.local)
    return flat[:, :2], hand.row, hand.column
