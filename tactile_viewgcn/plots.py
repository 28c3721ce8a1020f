"""Pictures: matplotlib figures, made where somebody keeps them."""

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

GAP = 1  # blank cells between the frames of a mosaic
WIDEST = 40  # inches
FRAMES = "viridis"  # colours of network input
NO_SENSOR = "#e9edef"


def confusions(counts: dict[str, np.ndarray], classes: list[str]) -> Figure:
    """Counts (C, C) by their panel's title, rows the true class, drawn side by side as shares of each row."""
    side = 2 + 0.28 * len(classes)
    figure = Figure(figsize=(1 + side * len(counts), side), layout="constrained")
    panels = figure.subplots(1, len(counts), sharey=True, squeeze=False)[0]
    for axes, (title, table) in zip(panels, counts.items(), strict=True):
        shares = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
        image = axes.imshow(shares, vmin=0, vmax=1, cmap="Blues")
        axes.set_xticks(range(len(classes)), classes, rotation=90, fontsize=8)
        axes.set_yticks(range(len(classes)), classes, fontsize=8)
        axes.set(xlabel="predicted", title=title)
    panels[0].set_ylabel("held")
    figure.colorbar(image, ax=panels, label="share of the object's view sets", shrink=0.8)
    return figure


def cluster_means(means: np.ndarray, live: np.ndarray, classes: list[str]) -> Figure:
    """Mean network input of each cluster (C, V, H, W), a row per class, drawn on the sensors' layout."""
    count, views, height, width = means.shape
    mosaic = np.full((count * (height + GAP), views * (width + GAP)), np.nan)
    for row in range(count):
        for column in range(views):
            top, left = row * (height + GAP), column * (width + GAP)
            mosaic[top : top + height, left : left + width] = np.where(live, means[row, column], np.nan)
    figure = Figure(figsize=(2 + min(0.8 * views, WIDEST), 1 + 0.8 * count), layout="compressed")
    axes = figure.add_subplot()
    image = axes.imshow(mosaic, cmap=FRAMES, vmin=0, vmax=np.nanpercentile(mosaic, 99.5) or 1)
    axes.set_yticks(np.arange(count) * (height + GAP) + height / 2, classes, fontsize=8)
    axes.set_xticks(np.arange(views) * (width + GAP) + width / 2, [str(column) for column in range(views)])
    axes.set(xlabel="cluster = viewpoint", title="mean frame of each cluster, training side")
    figure.colorbar(image, label="network input", shrink=0.4)
    return figure


def mean_frames(frames: np.ndarray, live: np.ndarray, titles: list[str], label: str, *, columns: int = 4) -> Figure:
    """Frames (n, H, W) on the sensors' layout, each under its title, with one scale for all.

    Args:
        live: bool (H, W); the other sensors are left grey.
        label: of the colour bar.
        columns: most frames in a row.
    """
    columns = min(columns, len(frames))
    rows, (height, width) = -(-len(frames) // columns), live.shape
    tall = min(max(height / width, 0.3), 1.6)
    figure = Figure(figsize=(1.9 * columns + 0.9, (1.9 * tall + 0.35) * rows), layout="compressed")
    panels = figure.subplots(rows, columns, squeeze=False)
    shown = np.where(live, frames, np.nan)
    top, colours = np.nanpercentile(shown, 99.5) or 1, colormaps[FRAMES].with_extremes(bad=NO_SENSOR)
    for axes in panels.flat:
        axes.set_axis_off()
    for axes, frame, title in zip(panels.flat, shown, titles, strict=False):
        image = axes.imshow(frame, cmap=colours, vmin=0, vmax=top, interpolation="none")
        axes.set_title(shortened(title), fontsize=9, parse_math=False)
    figure.colorbar(image, ax=panels, label=label, shrink=0.8, fraction=0.04)
    return figure


def curves(lines: dict[str, list[float]], title: str) -> Figure:
    """A panel for each quantity of a training over its epochs."""
    figure = Figure(figsize=(3.6 * len(lines), 2.7), layout="constrained")
    for axes, (name, values) in zip(figure.subplots(1, len(lines), squeeze=False)[0], lines.items(), strict=True):
        axes.plot(range(1, len(values) + 1), values, marker="o" if len(values) < 20 else None, markersize=3)
        axes.set(xlabel="epoch", title=f"{title}: {name.replace('_', ' ')}")
        axes.set_ylim(bottom=min(0, *values))
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.grid(alpha=0.3)
    return figure


def error_intervals(rows: dict[str, tuple[float, float, float]], chance: float) -> Figure:
    """Errors with their intervals on one line each, and the error of guessing; all as fractions.

    Args:
        rows: (error, low, high) by name.
    """
    figure = Figure(figsize=(5.4, 0.9 + 0.42 * len(rows)), layout="constrained")
    axes = figure.add_subplot()
    for place, (error, low, high) in enumerate(rows.values()):
        axes.plot([100 * low, 100 * high], [place, place], color="#7fb2c6", linewidth=7, solid_capstyle="butt")
        axes.plot(100 * error, place, "o", color="#12485c")
    axes.axvline(100 * chance, color="#a33", linestyle="--", linewidth=1.2)
    side = "right" if chance > 0.8 else "left"
    axes.text(100 * chance, -0.75, " guessing ", color="#a33", fontsize=9, ha=side, va="center")
    axes.set_yticks(range(len(rows)), list(rows))
    axes.set(xlim=(0, 100), ylim=(len(rows) - 0.5, -1), xlabel="wrong answers, %")
    axes.grid(axis="x", alpha=0.3)
    return figure


def shortened(name: str, most: int = 22) -> str:
    """A name that fits above a small picture."""
    return name if len(name) <= most else f"{name[: most - 1]}…"
