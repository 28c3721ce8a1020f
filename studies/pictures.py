"""The pictures of a study: errors by variant, against seconds or along a crossing, and the most confused pairs."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from studies.comparison import pareto_front
from studies.grid import name_and_place
from studies.variants import Variant


def errors_by_variant(rows: list[dict[str, Any]], sequential: list[dict[str, Any]], title: str) -> Figure:
    """A line for each variant, a mark on it for each protocol."""
    rows = [*rows, *sequential]
    variants, protocols = (list(dict.fromkeys(row[key] for row in rows)) for key in ("variant", "protocol"))
    figure = Figure(figsize=(8, 1.8 + 0.42 * len(variants)), layout="constrained")
    axes = figure.add_subplot()
    for number, protocol in enumerate(protocols):
        chosen = [row for row in rows if row["protocol"] == protocol]
        places = [variants.index(row["variant"]) + 0.2 * (number - (len(protocols) - 1) / 2) for row in chosen]
        errors = [row["error"] for row in chosen]
        axes.errorbar(errors, places, xerr=_bars(chosen), fmt="o", elinewidth=0.8, label=f"{protocol} protocol")
    axes.set_yticks(range(len(variants)), variants)
    axes.set(xlabel="error, %", ylim=(len(variants) - 0.5, -0.5))
    axes.grid(alpha=0.3, axis="x")
    figure.legend(fontsize=8, loc="outside lower center", ncols=len(protocols))
    figure.suptitle(title, fontsize=10)
    return figure


def errors_by_cost(rows: list[dict[str, Any]], sequential: list[dict[str, Any]], title: str) -> Figure:
    """Error under the last protocol against seconds of training, ms of an answer and, if any, number of frames."""
    protocol = rows[-1]["protocol"]
    trained = [row for row in rows if row["protocol"] == protocol]
    panels = [
        ("seconds of both trainings", trained, [row["pretrain s"] + row["finetune s"] for row in trained]),
        ("ms per view set, in batches", trained, [row["ms in batches"] for row in trained]),
        ("mean number of frames, one after the other", sequential, [row["frames"] for row in sequential]),
    ][: 3 if sequential else 2]
    figure = Figure(figsize=(6.5 * len(panels), 6), layout="constrained")
    for axes, (label, chosen, costs) in zip(figure.subplots(1, len(panels)), panels, strict=True):
        _front(axes, chosen, np.array(costs))
        axes.set(xlabel=label, ylabel=f"error, % ({protocol} protocol)")
    figure.suptitle(f"{title}; grey: Pareto front", fontsize=10)
    return figure


def error_curves(rows: list[dict[str, Any]], _sequential: list[dict[str, Any]], title: str) -> Figure:
    """A line for each variant under the last protocol: error along the crossing, against seconds and ms an answer.

    A crossing's names begin with a number, as `8 recordings` does; the other words are the first panel's label.
    """
    protocol = rows[-1]["protocol"]
    curves: dict[str, dict[int, dict[str, Any]]] = {}  # of each variant its rows, by the number of their place
    units: dict[int, str] = {}  # by number
    for row in rows:
        if row["protocol"] == protocol:
            name, place = name_and_place(row["variant"])
            number, _, unit = place.partition(" ")
            curves.setdefault(name, {})[int(number)] = row
            units[int(number)] = unit
    figure = Figure(figsize=(16, 6), layout="constrained")
    sizes, seconds, latencies = figure.subplots(1, 3, sharey=True)
    for count, (name, curve) in enumerate(curves.items()):
        chosen, style = [*curve.values()], "o-" if count < 10 else "s--"  # there are ten colours
        errors = [row["error"] for row in chosen]
        sizes.errorbar([*curve], errors, yerr=_bars(chosen), fmt=style, ms=4, elinewidth=0.8, label=name)
        seconds.plot([row["pretrain s"] + row["finetune s"] for row in chosen], errors, style, ms=4)
        latencies.plot([row["ms alone"] for row in chosen], errors, style, ms=4)
    for axes, label in ((seconds, "seconds of both trainings"), (latencies, "ms per view set, alone")):
        axes.set_xlabel(label)
        _log_axis(axes, np.concatenate([line.get_xdata() for line in axes.get_lines()]))
    unit = units[max(units)]  # in the plural
    sizes.set(xscale="log", xlabel=unit, ylabel=f"error, % ({protocol} protocol)")
    sizes.set_xticks([*units], map(str, units))
    sizes.minorticks_off()
    sizes.grid(alpha=0.3)
    figure.legend(loc="outside lower center", ncols=7, fontsize=8)
    figure.suptitle(title, fontsize=10)
    return figure


def _front(axes: Axes, rows: list[dict[str, Any]], costs: np.ndarray) -> None:
    errors, bars = np.array([row["error"] for row in rows]), _bars(rows)
    best = pareto_front(costs, errors)
    axes.step(costs[best], errors[best], "o-", where="post", color="0.8", lw=4, ms=14, zorder=0)
    middle = np.sqrt(costs.min() * costs.max())
    for number, (row, cost, error) in enumerate(zip(rows, costs, errors, strict=True)):
        colour = f"C{number % 10}"
        axes.errorbar(cost, error, yerr=bars[:, [number]], fmt="o", color=colour, elinewidth=0.8)
        # towards the middle, so that no label runs over the frame
        offset, side = ((-5, 4), "right") if cost > middle else ((5, 4), "left")
        axes.annotate(
            row["variant"], (cost, error), offset, textcoords="offset points", ha=side, fontsize=7, color=colour
        )
    _log_axis(axes, costs)


def _log_axis(axes: Axes, costs: np.ndarray) -> None:
    """A logarithmic axis over these costs, with so few labels that none touch."""
    axes.set_xscale("log")
    reach = costs.max() / costs.min()
    steps = range(1, 10) if reach < 5 else (1, 2, 5) if reach < 1e4 else (1,)
    axes.xaxis.set(major_locator=LogLocator(subs=steps), minor_locator=NullLocator(), major_formatter="{x:g}")
    axes.tick_params(axis="x", labelsize=7)
    axes.grid(alpha=0.3)


def _bars(rows: list[dict[str, Any]]) -> np.ndarray:
    """(2, n) reach of the intervals below and above the errors; NaN, which draws none, where there is none."""
    ends = np.array(
        [[row[key] if row.get(key, "") != "" else np.nan for row in rows] for key in ("low", "error", "high")]
    )
    return np.diff(ends, axis=0).clip(0)


def side_by_side(pairs: list[dict[str, Any]], variant: Variant, title: str) -> Figure:
    """The two mean frames (H, W) of each pair over the evaluated sides, a column each."""
    live = variant.answers[0].predictions.live
    names = [(pair["object"], pair["and"]) for pair in pairs]
    means = {name: np.where(live, variant.mean_frame(name), np.nan) for pair in names for name in pair}
    top = max(np.nanpercentile(list(means.values()), 99.5), 1e-6)
    figure = Figure(figsize=(2.2 * len(pairs), 5.2), layout="constrained")
    panels = figure.subplots(2, len(pairs), squeeze=False)
    for column, pair in enumerate(names):
        for axes, name in zip(panels[:, column], pair, strict=True):
            axes.imshow(means[name], vmin=0, vmax=top, cmap="viridis")
            axes.set_title(name, fontsize=9)
            axes.set_axis_off()
        share = f"{pairs[column]['taken for each other, %']:.0f} %"
        axes.text(0.5, -0.08, share, transform=axes.transAxes, ha="center")
    figure.suptitle(title)
    return figure
