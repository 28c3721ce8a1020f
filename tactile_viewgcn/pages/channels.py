"""Curves of channels over time, of one recording of each object; each may be in its own unit."""

from typing import NamedTuple

import numpy as np

from tactile_viewgcn.messages import shown
from tactile_viewgcn.pages import html
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

MOST_OBJECTS = 40  # shown
MOST_CHANNELS = 32  # shown
MOST_POINTS = 200  # of a curve
NAME_LETTERS = 14  # of a channel
WIDTH_INCHES, ROW_INCHES = 3.4, 0.3


class Curves(NamedTuple):
    """The picture of one recording: names of its object and of itself, and the address of an SVG."""

    object: str
    recording: str
    picture: str


def channel_curves(recordings: Recordings) -> list[Curves]:
    """The curves of the middle recording of each object, for up to 40 objects and 32 live channels."""
    columns = recordings.columns
    of_object = dict[int, list[np.ndarray]]()
    for index in frames_by_recording(recordings):
        of_object.setdefault(int(columns["object"][index[0]]), []).append(index)
    chosen = {
        label: parts[len(parts) // 2] for label, parts in sorted(of_object.items())[:MOST_OBJECTS]
    }
    live = recordings.live_counts()
    channels = evenly(np.arange(live.shape[1]), MOST_CHANNELS)
    readings = {
        label: live[evenly(index, MOST_POINTS)][:, channels] for label, index in chosen.items()
    }
    everything = np.concatenate([*readings.values()]).astype(np.float64)
    low, high = everything.min(axis=0), everything.max(axis=0)
    every_name = recordings.sensor_names(recordings.live)
    names = [every_name[channel] for channel in channels]
    return [
        Curves(
            recordings.objects[label],
            recordings.recordings[columns["recording"][index[0]]],
            _picture(readings[label], low, high, names),
        )
        for label, index in chosen.items()
    ]


def _picture(readings: np.ndarray, low: np.ndarray, high: np.ndarray, names: list[str]) -> str:
    """The address of an SVG with the curves of readings (n, C), one above another, the first at the top.

    Args:
        low, high: (C,) readings at the bottom and at the top of a curve's row.
        names: of the channels.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_INCHES, ROW_INCHES * (len(names) + 1)))
    axes = figure.add_subplot()
    span = np.where(high > low, high - low, 1.0)
    heights = 0.8 * (readings - low) / span
    for row in range(len(names)):
        axes.plot(
            heights[:, row] - row,
            linewidth=0.8,
            color="#0b5c7d",
            marker="." if len(readings) == 1 else "",
        )
        axes.axhline(-row - 0.1, color="#d5dde1", linewidth=0.5)
    labels = [
        shown(name if len(name) <= NAME_LETTERS else f"{name[: NAME_LETTERS - 1]}…")
        for name in names
    ]
    axes.set_yticks(0.4 - np.arange(len(names)), labels, fontsize=7, parse_math=False)
    axes.set_ylim(-len(names) + 0.8, 0.95)
    axes.set_xticks([])
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    return html.svg(figure)
