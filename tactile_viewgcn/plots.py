"""Pictures of runs, as Matplotlib figures."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tactile_viewgcn.messages import shown


def confusion(counts: np.ndarray, classes: list[str]) -> Figure:
    """Counts of answers (C, C), true class by predicted class, as shares of each row."""
    side, names = 2 + 0.28 * len(classes), list(map(shown, classes))
    figure = Figure(figsize=(1 + side, side), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(
        counts / np.maximum(counts.sum(axis=1, keepdims=True), 1), vmin=0, vmax=1, cmap="Blues"
    )
    axes.set_xticks(range(len(classes)), names, rotation=90, fontsize=8, parse_math=False)
    axes.set_yticks(range(len(classes)), names, fontsize=8, parse_math=False)
    axes.set(xlabel="predicted", ylabel="object")
    figure.colorbar(image, ax=axes, label="share of the object's answers", shrink=0.8)
    return figure


def errors_by_frames(errors: dict[str, list[tuple[int, dict[str, Any]]]], chance: float) -> Figure:
    """Errors by the number of frames, with their intervals: a line for each name.

    Args:
        errors: by name, numbers of frames, and `mean`, `low` and `high` as fractions; the latter
            two may be None.
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
