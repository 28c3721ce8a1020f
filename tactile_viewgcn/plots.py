"""Draws pictures of runs as Matplotlib figures."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tactile_viewgcn.messages import shown

LINE_COLOURS = ("#c77d2b", "#12485c")


def confusion(counts: np.ndarray, classes: list[str]) -> Figure:
    """Return a picture of the answers, as shares of each row.

    Args:
        counts: (C, C) numbers of answers, a row for each true class, a column for each answer.
        classes: names of the C classes.
    """
    names = [shown(name) for name in classes]
    inches = 2 + 0.28 * len(classes)
    figure = Figure(figsize=(1 + inches, inches), layout="constrained")
    axes = figure.subplots()
    answers = np.maximum(counts.sum(axis=1, keepdims=True), 1)
    image = axes.imshow(counts / answers, vmin=0, vmax=1, cmap="Blues")
    axes.set_xticks(range(len(classes)), names, rotation=90, fontsize=8, parse_math=False)
    axes.set_yticks(range(len(classes)), names, fontsize=8, parse_math=False)
    axes.set(xlabel="predicted", ylabel="object")
    figure.colorbar(image, ax=axes, label="share of the object's answers", shrink=0.8)
    return figure


def errors_by_frames(errors: dict[str, list[tuple[int, dict[str, Any]]]], chance: float) -> Figure:
    """Return a picture of errors by the number of frames, with their intervals.

    Args:
        errors: by name of a line, pairs of a number of frames and its error. An error has `mean`,
            `low` and `high` as fractions; the last two can be None.
        chance: the error of chance, as a fraction.
    """
    figure = Figure(figsize=(5.4, 3.2), layout="constrained")
    axes = figure.add_subplot()
    numbers = set[int]()
    for (name, points), colour in zip(errors.items(), LINE_COLOURS, strict=False):
        frames = [count for count, _ in points]
        numbers.update(frames)
        intervals = [error for _, error in points]
        low = _per_cent(intervals, "low")
        high = _per_cent(intervals, "high")
        axes.fill_between(frames, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.plot(frames, _per_cent(intervals, "mean"), "o-", color=colour, label=name)
    axes.axhline(100 * chance, color="#a33", linestyle="--", linewidth=1.2, label="chance")
    axes.set_xscale("log", base=2)
    ticks = sorted(numbers)
    axes.set_xticks(ticks, list(map(str, ticks)))
    axes.minorticks_off()
    axes.set(ylim=(0, 100), xlabel="frames", ylabel="wrong answers, %")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=9)
    return figure


def live_errors(rows: list[dict[str, Any]], chance: float) -> Figure:
    """Return a picture of the errors of a stream by the time of contact, with their intervals.

    Args:
        rows: rows of live.csv, see `evaluation/live.py`.
        chance: the error of chance, as a fraction.
    """
    so_far = [row for row in rows if row["answer"] == "so far"]
    (final,) = [row for row in rows if row["answer"] == "final"]
    of_predict = [row["error"] for row in rows if row["answer"] == "predict"]
    sure = [row for row in rows if row["answer"] == "sure" and row["error"] is not None]
    levels = [row["level"] for row in so_far]
    places = [*levels, 2 * levels[-1]]
    of_others, of_stream = LINE_COLOURS
    figure = Figure(figsize=(5.4, 3.2), layout="constrained")
    axes = figure.add_subplot()
    low = _per_cent([*so_far, final], "low")
    high = _per_cent([*so_far, final], "high")
    errors = _per_cent([*so_far, final], "error")
    axes.fill_between(places, low, high, color=of_stream, alpha=0.15, linewidth=0)
    axes.plot(places, errors, "o-", color=of_stream, label="answers so far")
    if sure:
        contact = [max(row["contact"], levels[0]) for row in sure]
        axes.plot(contact, _per_cent(sure, "error"), "D", color=of_others, label="sure answers")
        # the offsets keep the labels of near points apart
        for place, row, below in zip(contact, sure, (-3, 4, -11), strict=False):
            text = f"{100 * row['level']:g} %"
            position = (place, 100 * row["error"])
            axes.annotate(text, position, (6, below), textcoords="offset points", fontsize=8)
    for error in of_predict:  # one or none
        axes.axhline(100 * error, color=of_others, linewidth=1.5, label="predict")
    axes.axhline(100 * chance, color="#a33", linestyle="--", linewidth=1.2, label="chance")
    axes.set_xscale("log", base=2)
    axes.set_xticks(places, [*(f"{level:g}" for level in levels), "end"])
    axes.minorticks_off()
    unit = "frames"
    if final["unit"] == "s":
        unit = "seconds"
    axes.set(ylim=(0, 100), xlabel=f"{unit} of contact", ylabel="wrong answers, %")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=9)
    return figure


def _per_cent(errors: list[dict[str, Any]], name: str) -> np.ndarray:
    """Return the values of a name in per cent, NaN for None."""
    return 100 * np.array([error[name] for error in errors], dtype=float)
