"""Error against what it costs: a panel per question, the Pareto front drawn."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLOURS = {"time": "C0", "views": "C1", "width": "C2", "reuse": "C3", "precision": "C4", "touches": "C5"}
PROTOCOL = "recording"


def picture(rows: list[dict], title: str) -> Figure:
    """A panel for each cost that the rows have: training time, latency alone and in batches, touches, precision."""
    rows = [row for row in rows if row["protocol"] == PROTOCOL]

    def on(*axes: str) -> list[dict]:
        return [row for row in rows if row["axis"] in axes]

    training, latency = on("time", "views", "width", "reuse"), on("views", "width")
    panels = [
        (training, "seconds of both trainings", lambda row: row["pretrain"] + row["finetune"]),
        (on("reuse"), "seconds of fine-tuning", lambda row: row["finetune"]),
        (latency, "ms per view set, alone", lambda row: row["single_ms"]),
        (latency, "ms per view set, in batches of 256", lambda row: row["batch_ms"]),
        (on("precision"), "ms per view set, in batches of 256", lambda row: row["batch_ms"]),
        (on("touches"), "mean number of touches", lambda row: row["touches"]),
    ]
    panels = [panel for panel in panels if panel[0]]
    columns = min(3, len(panels))
    lines = -(-len(panels) // columns)
    figure = Figure(figsize=(5.2 * columns, 4.8 * lines), layout="constrained")
    for axes, panel in zip(figure.subplots(lines, columns, squeeze=False).ravel(), panels, strict=False):
        _panel(axes, *panel)
    figure.suptitle(f"{title}, {PROTOCOL} protocol.\nBars: 95 % interval over groups; grey: Pareto front")
    return figure


def front(costs: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Indices of the points that no other is as cheap and as good as, and better in one; from the cheapest on."""
    order = np.lexsort((errors, costs))
    before = np.concatenate([[np.inf], np.minimum.accumulate(errors[order])[:-1]])
    return order[errors[order] < before]


def _panel(axes: Axes, rows: list[dict], label: str, cost: Callable[[dict], float]) -> None:
    costs, errors = np.array([cost(row) for row in rows]), np.array([row["error"] for row in rows])
    best = front(costs, errors)
    axes.step(costs[best], errors[best], "o-", where="post", color="0.8", lw=4, ms=14, zorder=0)
    for axis in dict.fromkeys(row["axis"] for row in rows):
        own = [number for number, row in enumerate(rows) if row["axis"] == axis]
        known = all(rows[number]["low"] != "" for number in own)
        ends = np.array([[rows[number]["low"], rows[number]["high"]] for number in own]) if known else None
        bars = np.abs(ends.T - errors[own]) if known else None
        axes.errorbar(costs[own], errors[own], bars, fmt="o", color=COLOURS[axis], elinewidth=0.6, label=axis)
        for number in own:
            place = (costs[number], errors[number])
            axes.annotate(rows[number]["value"], place, (4, 3), textcoords="offset points", fontsize=7)
    if rows[0]["axis"] != "touches":
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("{x:g}")
        axes.tick_params(axis="x", which="both", labelsize=7)
    axes.set(xlabel=label, ylabel="error, %")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
