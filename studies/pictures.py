"""The picture of a study: errors against seconds of training, or along a crossing."""

from collections.abc import Collection

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from studies.comparison import pareto_front


def errors_by_seconds(rows: pd.DataFrame, references: Collection[str], title: str) -> Figure:
    """Error against seconds of training, a panel for each protocol, with numbers for Pareto fronts and references."""
    rows = rows.assign(seconds=rows["pretrain s"] + rows["finetune s"])
    panels = [panel for _, panel in rows.groupby("protocol", sort=False)]
    variants, costs = panels[0]["variant"].reset_index(drop=True), panels[0]["seconds"].to_numpy()
    fronts = [pareto_front(costs, panel["error"].to_numpy()) for panel in panels]
    named = (
        variants.isin(references) | variants.str.partition(" / ")[0].isin(references)
    ).to_numpy()
    numbered = sorted({*np.hstack(fronts), *np.flatnonzero(named)}, key=costs.__getitem__)
    figure = Figure(figsize=(5.6 * len(panels), 5.4), layout="constrained")
    figure.subplots(1, len(panels), sharey=True)
    for axes, panel, front in zip(figure.axes, panels, fronts, strict=True):
        errors = panel["error"].to_numpy()
        axes.errorbar(costs, errors, yerr=_bars(panel), fmt="o", color="0.6", ms=4, elinewidth=0.6)
        axes.plot(costs[front], errors[front], "o-", drawstyle="steps-post", color="C0", ms=6)
        axes.plot(costs[named], errors[named], "*", color="C3", ms=14)
        for number, place in enumerate(numbered, start=1):
            at = costs[place], errors[place]
            axes.annotate(
                str(number),
                at,
                (-7, 0),
                textcoords="offset points",
                ha="right",
                va="center",
                fontsize=9,
            )
            axes.plot([], [], " ", label=f"{number}  {variants[place]}")
        axes.grid(alpha=0.3)
        axes.set(xscale="log", xlabel="seconds of both trainings", title=panel["protocol"].iloc[0])
    stars = "; ".join(["blue: Pareto front", *(f"star: {name}" for name in variants[named])])
    _finish(figure, f"{title}\n{stars}", handlelength=0, handletextpad=0)
    return figure


def error_curves(rows: pd.DataFrame, title: str) -> Figure:
    """A panel for each protocol, a line in it for each variant: the error along the crossing.

    A crossing's names begin with a number, as in `8 recordings`; the other words label the axis.
    """
    rows = rows.join(rows["variant"].str.extract(r"(?P<name>.*) / (?P<number>\d+) ?(?P<unit>.*)"))
    rows["number"] = rows["number"].astype(int)
    protocols = rows["protocol"].unique()
    figure = Figure(figsize=(4.8 * len(protocols), 5), layout="constrained")
    figure.subplots(1, len(protocols), sharey=True)
    for axes, protocol in zip(figure.axes, protocols, strict=True):
        for name, curve in rows[rows["protocol"] == protocol].groupby("name", sort=False):
            axes.errorbar(
                curve["number"],
                curve["error"],
                _bars(curve),
                fmt="o-",
                ms=4,
                elinewidth=0.8,
                label=name,
            )
        axes.set(title=protocol, xlabel=rows.loc[rows["number"].idxmax(), "unit"])  # in the plural
        axes.set_xscale("log")
        axes.xaxis.set(minor_locator=NullLocator())
        axes.set_xticks(rows["number"].unique(), rows["number"].unique().astype(str))
        axes.grid(alpha=0.3)
    _finish(figure, title)
    return figure


def _finish(figure: Figure, title: str, **legend: float) -> None:
    """Label the errors, and put the first panel's legend below all panels."""
    figure.axes[0].set_ylabel("error, %")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9, **legend)
    figure.suptitle(title, fontsize=10)


def _bars(rows: pd.DataFrame) -> np.ndarray:
    """(2, n) lengths of the intervals below and above the errors; NaN, which draws nothing, where there is none."""
    return np.diff(rows[["low", "error", "high"]].to_numpy().T, axis=0).clip(0)
