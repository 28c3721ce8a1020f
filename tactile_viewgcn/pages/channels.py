"""Draws the channels of one recording of each object over time; each can have its own unit."""

from typing import NamedTuple

import numpy as np

from tactile_viewgcn.messages import shown
from tactile_viewgcn.pages import html
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

MOST_OBJECTS = 40  # number of objects whose curves are shown
MOST_CHANNELS = 32  # number of channels that are shown
MOST_POINTS = 200  # points of a curve
NAME_LETTERS = 14  # letters of a channel's name
WIDTH_INCHES = 3.4  # of a picture
ROW_INCHES = 0.3  # height of a curve's row
FILLED = 0.8  # share of the row that a curve fills
CURVE_COLOUR = "#0b5c7d"
LINE_COLOUR = "#d5dde1"  # colour of the lines between two rows


class Curves(NamedTuple):
    """The picture of one recording: its object, its name, and the address of an SVG."""

    object: str
    recording: str
    picture: str


def channel_curves(recordings: Recordings) -> list[Curves]:
    """Return the curves of the middle recording of each object.

    Args:
        recordings: at most 40 of their objects, and at most 32 channels that vary, are shown.

    Returns:
        The curves of each object. Each channel has the same scale for all objects.
    """
    chosen = _middle_recordings(recordings)
    live_counts = recordings.live_counts()
    channels = evenly(np.arange(live_counts.shape[1]), MOST_CHANNELS)
    readings = {
        label: live_counts[evenly(index, MOST_POINTS)][:, channels]
        for label, index in chosen.items()
    }
    all_readings = np.concatenate([*readings.values()]).astype(np.float64)
    low = all_readings.min(axis=0)
    high = all_readings.max(axis=0)
    live_names = recordings.sensor_names(recordings.live)
    names = [live_names[channel] for channel in channels]
    curves = list[Curves]()
    for label, index in chosen.items():
        recording = recordings.columns["recording"][index[0]]
        picture = _picture(readings[label], low, high, names)
        curves.append(Curves(recordings.objects[label], recordings.recordings[recording], picture))
    return curves


def _middle_recordings(recordings: Recordings) -> dict[int, np.ndarray]:
    """Return the frames of the middle recording of each of the first 40 objects, by label."""
    by_object = dict[int, list[np.ndarray]]()
    for index in frames_by_recording(recordings):
        label = int(recordings.columns["object"][index[0]])
        by_object.setdefault(label, []).append(index)
    shown_labels = sorted(by_object)[:MOST_OBJECTS]
    return {label: by_object[label][len(by_object[label]) // 2] for label in shown_labels}


def _picture(readings: np.ndarray, low: np.ndarray, high: np.ndarray, names: list[str]) -> str:
    """Return the address of an SVG with the curves of a recording, one above another.

    Args:
        readings: (n, C); channel 0 is at the top.
        low: (C,) reading at the bottom of each curve's row.
        high: (C,) reading at the top of each curve's row.
        names: names of the C channels.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_INCHES, ROW_INCHES * (len(names) + 1)))
    axes = figure.add_subplot()
    span = np.where(high > low, high - low, 1.0)
    heights = FILLED * (readings - low) / span
    marker = ""
    if len(readings) == 1:
        marker = "."
    for row in range(len(names)):
        axes.plot(heights[:, row] - row, linewidth=0.8, color=CURVE_COLOUR, marker=marker)
        axes.axhline(-row - 0.1, color=LINE_COLOUR, linewidth=0.5)
    labels = [shown(_shortened(name)) for name in names]
    axes.set_yticks(0.4 - np.arange(len(names)), labels, fontsize=7, parse_math=False)
    axes.set_ylim(-len(names) + 0.8, 0.95)
    axes.set_xticks([])
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    return html.svg(figure)


def _shortened(name: str) -> str:
    if len(name) <= NAME_LETTERS:
        return name
    return f"{name[: NAME_LETTERS - 1]}…"
