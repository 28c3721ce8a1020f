"""Pictures of runs and recordings, as Matplotlib figures."""

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from tactile_viewgcn.messages import shown

FRAMES = "viridis"  # colours of frames
LONGEST = 22  # characters above a small picture
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


def mean_frames(frames: np.ndarray, live: np.ndarray, titles: list[str], label: str) -> Figure:
    """Frames (n, H, W), each under its title, with one scale for all.

    Args:
        live: bool (H, W), the sensors that vary; the others are grey.
        label: label of the colour bar.
    """
    columns = min(5, len(titles))
    rows, shape = -(-len(titles) // columns), min(max(live.shape[0] / live.shape[1], 0.6), 1.6)
    figure = Figure(figsize=(1.9 * columns + 0.6, rows * (1.9 * shape + 0.35) + 0.3), layout="compressed")
    panels = [figure.add_subplot(rows, columns, number) for number in range(1, len(titles) + 1)]
    masked = np.where(live, frames, np.nan)
    top, colours = np.nanpercentile(masked, 99.5) or 1, colormaps[FRAMES].with_extremes(bad=NO_SENSOR)
    for axes, frame, title in zip(panels, masked, map(shown, titles), strict=True):
        image = axes.imshow(frame, cmap=colours, vmin=0, vmax=top, interpolation="none")
        axes.set_axis_off()
        axes.set_title(title if len(title) <= LONGEST else f"{title[: LONGEST - 1]}…", fontsize=9, parse_math=False)
    figure.colorbar(image, ax=panels, fraction=0.04).set_label(label, fontsize=8)
    return figure


def errors_by_frames(errors: dict[str, list[tuple[int, dict[str, Any]]]], chance: float) -> Figure:
    """Errors by the number of frames, with their intervals: a line for each name.

    Args:
        errors: by name, numbers of frames, and `mean`, `low` and `high` as fractions; the latter two may be None.
        chance: error of guessing.
    """
    figure = Figure(figsize=(5.4, 3.2), layout="constrained")
    axes = figure.add_subplot()
    for (name, points), colour in zip(errors.items(), ("#c77d2b", "#12485c"), strict=False):
        frames = [count for count, _ in points]
        ends = [[error[end] for _, error in points] for end in ("low", "mean", "high")]
        low, mean, high = 100 * np.array(ends, float)
        axes.fill_between(frames, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.plot(frames, mean, "o-", color=colour, label=name)
    axes.axhline(100 * chance, color="#a33", linestyle="--", linewidth=1.2, label="guessing")
    axes.set_xscale("log", base=2)
    ticks = sorted({count for points in errors.values() for count, _ in points})
    axes.set_xticks(ticks, list(map(str, ticks)))
    axes.minorticks_off()
    axes.set(ylim=(0, 100), xlabel="frames", ylabel="wrong answers, %")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=9)
    return figure
