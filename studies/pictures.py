"""The pictures of a study: errors by variant, against a cost, or along a crossing."""

from collections.abc import Collection

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from studies.comparison import pareto_front


def errors_by_variant(rows: pd.DataFrame, title: str) -> Figure:
    """A line for each variant, a mark on it for each protocol."""
    variants, protocols = list(rows["variant"].unique()), rows["protocol"].unique()
    figure = Figure(figsize=(8, 1.8 + 0.42 * len(variants)), layout="constrained")
    axes = figure.add_subplot()
    for number, protocol in enumerate(protocols):
        chosen = rows[rows["protocol"] == protocol]
        places = chosen["variant"].map(variants.index) + 0.2 * (number - (len(protocols) - 1) / 2)
        axes.errorbar(
            chosen["error"], places, xerr=_bars(chosen), fmt="o", elinewidth=0.8, label=f"{protocol} protocol"
        )
    axes.set_yticks(range(len(variants)), variants)
    axes.set(xlabel="error, %", ylim=(len(variants) - 0.5, -0.5))
    axes.grid(alpha=0.3, axis="x")
    figure.legend(fontsize=8, loc="outside lower center", ncols=len(protocols))
    figure.suptitle(title, fontsize=10)
    return figure


def errors_by_cost(rows: pd.DataFrame, cost: str, label: str, references: Collection[str], title: str) -> Figure:
    """Error under the last protocol against a cost, with numbers for the Pareto front, presets and references.

    Args:
        cost: `seconds` of both trainings, or a column of the rows; label: label of its axis.
    """
    rows = of_last_protocol(rows)
    costs, errors, bars = rows[cost].to_numpy(), rows["error"].to_numpy(), _bars(rows)
    figure = Figure(figsize=(6.4, 5.4), layout="constrained")
    axes = figure.add_subplot()
    axes.errorbar(costs, errors, yerr=bars, fmt="o", color="0.6", ms=4, elinewidth=0.6)
    best = pareto_front(costs, errors)
    axes.plot(costs[best], errors[best], "o-", drawstyle="steps-post", color="C0", ms=6)
    named = (rows["variant"].isin(references) | rows["variant"].str.partition(" / ")[0].isin(references)).to_numpy()
    axes.plot(costs[named], errors[named], "*", color="C3", ms=14)
    presets = np.flatnonzero(rows["variant"].str.startswith("preset "))
    numbered = sorted({*best, *np.flatnonzero(named), *presets}, key=costs.__getitem__)
    for number, place in enumerate(numbered, start=1):
        at = costs[place], errors[place]
        axes.annotate(str(number), at, (-7, 0), textcoords="offset points", ha="right", va="center", fontsize=9)
        axes.plot([], [], " ", label=f"{number}  {rows['variant'].iloc[place]}")
    _log_axis(axes, costs)
    axes.set(xlabel=label, ylabel=f"error, % ({rows['protocol'].iloc[0]} protocol)")
    figure.legend(fontsize=9, loc="outside lower center", ncols=3, handlelength=0, handletextpad=0)
    stars = "; ".join(["blue: Pareto front", *(f"star: {name}" for name in rows["variant"][named])])
    figure.suptitle(f"{title}\n{stars}", fontsize=10)
    return figure


def error_curves(rows: pd.DataFrame, title: str) -> Figure:
    """A panel for each protocol, a line in it for each variant: the error along the crossing.

    A crossing's names begin with a number, as in `8 recordings`; the other words label the axis.
    """
    rows = rows.join(rows["variant"].str.extract(r"(?P<name>.*) / (?P<number>\d+) ?(?P<unit>.*)"))
    rows["number"] = rows["number"].astype(int)
    protocols = rows["protocol"].unique()
    figure = Figure(figsize=(4.8 * len(protocols), 5), layout="constrained")
    panels = figure.subplots(1, len(protocols), sharey=True, squeeze=False)[0]
    for axes, protocol in zip(panels, protocols, strict=True):
        for name, curve in rows[rows["protocol"] == protocol].groupby("name", sort=False):
            axes.errorbar(curve["number"], curve["error"], _bars(curve), fmt="o-", ms=4, elinewidth=0.8, label=name)
        axes.set(title=f"{protocol} protocol", xlabel=rows.loc[rows["number"].idxmax(), "unit"])  # in the plural
        axes.set_xscale("log")
        axes.xaxis.set(minor_locator=NullLocator())
        axes.set_xticks(rows["number"].unique(), rows["number"].unique().astype(str))
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("error, %")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
    figure.suptitle(title, fontsize=10)
    return figure


def of_last_protocol(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of the last protocol, with the `seconds` of both trainings."""
    chosen = rows[rows["protocol"] == rows["protocol"].iloc[-1]]
    return chosen.assign(seconds=chosen["pretrain s"] + chosen["finetune s"])


def _log_axis(axes: Axes, costs: np.ndarray) -> None:
    """Make the x axis logarithmic, with few enough labels for these costs that none touch."""
    axes.set_xscale("log")
    reach = costs.max() / costs.min()
    steps = range(1, 10) if reach < 5 else (1, 2, 5) if reach < 1e4 else (1,)
    axes.xaxis.set(major_locator=LogLocator(subs=steps), minor_locator=NullLocator(), major_formatter="{x:g}")
    axes.tick_params(axis="x", labelsize=7)
    axes.grid(alpha=0.3)


def _bars(rows: pd.DataFrame) -> np.ndarray:
    """(2, n) lengths of the intervals below and above the errors; NaN, which draws nothing, where there is none."""
    return np.diff(rows[["low", "error", "high"]].to_numpy().T, axis=0).clip(0)
