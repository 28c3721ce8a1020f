"""Pictures of runs and recordings, as Matplotlib figures."""

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from tactile_viewgcn.messages import shown

FRAMES = "viridis"  # colours of frames
LONGEST_NAME = 22  # characters above a small picture
NO_SENSOR = "#e9edef"


def confusions(counts: dict[str, np.ndarray], classes: list[str]) -> Figure:
    """Tables of counts (C, C), true class by predicted class, side by side as shares of each row.

    Args:
        counts: each table by the title of its panel.
    """
    side, names = 2 + 0.28 * len(classes), list(map(shown, classes))
    figure = Figure(figsize=(1 + side * len(counts), side), layout="constrained")
    panels = figure.subplots(1, len(counts), sharey=True, squeeze=False)[0]
    for axes, (title, table) in zip(panels, counts.items(), strict=True):
        shares = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
        image = axes.imshow(shares, vmin=0, vmax=1, cmap="Blues")
        axes.set_xticks(range(len(classes)), names, rotation=90, fontsize=8, parse_math=False)
        axes.set_yticks(range(len(classes)), names, fontsize=8, parse_math=False)
        axes.set(xlabel="predicted", title=title)
    panels[0].set_ylabel("object")
    figure.colorbar(image, ax=panels, label="share of the object's view sets", shrink=0.8)
    return figure


def mean_frames(frames: np.ndarray, live: np.ndarray, titles: list[str], label: str, *, columns: int = 4) -> Figure:
    """Frames (n, H, W), each under its title, with one scale for all.

    Args:
        live: bool (H, W), the sensors that vary; the others are grey.
        label: label of the colour bar.
        columns: most frames in a row.
    """
    columns = min(columns, len(frames))
    rows, (height, width) = -(-len(frames) // columns), live.shape
    tall = min(max(height / width, 0.3), 1.6)
    side = 1.9 if len(frames) > 1 else 3.2  # inches
    figure = Figure(figsize=(side * columns + 0.9, (side * tall + 0.35) * rows), layout="compressed")
    panels = figure.subplots(rows, columns, squeeze=False)
    shown = np.where(live, frames, np.nan)
    top, colours = np.nanpercentile(shown, 99.5) or 1, colormaps[FRAMES].with_extremes(bad=NO_SENSOR)
    for axes in panels.flat:
        axes.set_axis_off()
    for axes, frame, title in zip(panels.flat, shown, titles, strict=False):
        image = axes.imshow(frame, cmap=colours, vmin=0, vmax=top, interpolation="none")
        axes.set_title(shortened(title), fontsize=9, parse_math=False)
    bar = figure.colorbar(image, ax=panels, shrink=1 if rows == 1 else 0.6, fraction=0.04)
    bar.set_label(label, fontsize=8)
    return figure


def errors_by_views(errors: dict[str, dict[str, dict[str, Any]]], chance: float) -> Figure:
    """Errors by the number of views, with their intervals: a line for each name.

    Args:
        errors: `mean`, `low` and `high`, as fractions, by number of views and name; ends are None without an interval.
        chance: error of guessing.
    """
    figure = Figure(figsize=(5.4, 3.2), layout="constrained")
    axes = figure.add_subplot()
    for (name, by_views), colour in zip(errors.items(), ("#12485c", "#c77d2b"), strict=False):
        views = list(map(int, by_views))
        low, mean, high = (
            100 * np.array([error[end] for error in by_views.values()], float) for end in ("low", "mean", "high")
        )
        axes.fill_between(views, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.plot(views, mean, "o-", color=colour, label=name)
    axes.axhline(100 * chance, color="#a33", linestyle="--", linewidth=1.2, label="guessing")
    axes.set_xscale("log", base=2)
    ticks = sorted({int(count) for by_views in errors.values() for count in by_views})
    axes.set_xticks(ticks, list(map(str, ticks)))
    axes.minorticks_off()
    axes.set(ylim=(0, 100), xlabel="frames", ylabel="wrong answers, %")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=9)
    return figure


def shortened(name: str) -> str:
    """A name, cut to fit above a small picture."""
    name = shown(name)
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…"


def time_lines(
    lines: list[np.ndarray], in_contact: list[np.ndarray], seconds: list[float], titles: list[str]
) -> Figure:
    """The load of recordings over time, side by side with one scale; filled where frames are in contact.

    Args:
        lines: mean counts above the baseline at points along each recording.
        in_contact: share of each point's frames that are in contact.
        seconds: length of each recording; NaN where it is unknown, and the axis is then a share of the recording.
    """
    columns = min(3, len(lines))
    rows = -(-len(lines) // columns)
    figure = Figure(figsize=(3.1 * columns, 1.75 * rows + 0.3), layout="constrained")
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for axes in panels.flat[len(lines) :]:
        axes.set_visible(False)
    for axes, line, share, length, title in zip(panels.flat, lines, in_contact, seconds, titles, strict=False):
        at = np.linspace(0, 1 if np.isnan(length) else length, len(line))
        axes.plot(at, line, color="#12485c", linewidth=1)
        axes.fill_between(at, 0, line, where=share >= 0.5, color="#f2b45c", alpha=0.8, linewidth=0)
        axes.set_title(shortened(title), fontsize=9, parse_math=False)
        axes.tick_params(labelsize=8)
    timed = not np.isnan(seconds).any()
    figure.supxlabel("seconds" if timed else "share of the recording", fontsize=9)
    figure.supylabel("mean reading above baseline", fontsize=9)
    return figure
