"""The picture of a study: errors against seconds of training, or along the numbers of `cross`."""

from collections.abc import Collection, Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from studies.comparison import pareto_front
from tactile_viewgcn.evaluation.trials import TITLES, WHOLE


def errors_by_seconds(rows: pd.DataFrame, references: Collection[str], title: str) -> Figure:
    """Return a picture of error against seconds of training, a panel for each protocol.

    The points on a Pareto front and the references have numbers, which the legend explains.

    Args:
        rows: see `comparison.rows_of`.
        references: names of variants, or the first parts of names; they are drawn as stars.
        title: text above the panels.
    """
    panels = [panel for _, panel in rows.groupby("protocol", sort=False)]
    first = panels[0].reset_index(drop=True)
    variants = first["variant"]
    seconds = (first["pretrain s"] + first["finetune s"]).to_numpy()
    fronts = [pareto_front(seconds, panel["error"].to_numpy()) for panel in panels]
    is_reference = variants.isin(references) | variants.str.partition(" / ")[0].isin(references)
    starred = np.flatnonzero(is_reference)
    numbered = sorted({*np.hstack(fronts), *starred}, key=lambda index: seconds[index])
    figure = Figure(figsize=(5.6 * len(panels), 5.4), layout="constrained")
    figure.subplots(1, len(panels), sharey=True)
    for axes, panel, front in zip(figure.axes, panels, fronts, strict=True):
        errors = panel["error"].to_numpy()
        axes.errorbar(
            seconds, errors, yerr=_bars(panel), fmt="o", color="0.6", ms=4, elinewidth=0.6
        )
        axes.plot(seconds[front], errors[front], "o-", drawstyle="steps-post", color="C0", ms=6)
        axes.plot(seconds[starred], errors[starred], "*", color="C3", ms=14)
        for number, index in enumerate(numbered, start=1):
            _write_number(axes, number, (seconds[index], errors[index]))
            axes.plot([], [], " ", label=f"{number}  {variants[index]}")
        axes.grid(alpha=0.3)
        protocol = panel["protocol"].iloc[0]
        axes.set(xscale="log", xlabel="seconds of both training runs", title=protocol)
    explained = ["blue: Pareto front"]
    explained += [f"star: {name}" for name in variants[starred]]
    _finish(figure, f"{title}\n{'; '.join(explained)}", handlelength=0, handletextpad=0)
    return figure


def _write_number(axes: Axes, number: int, point: tuple[float, float]) -> None:
    """Write a number to the left of a point."""
    axes.annotate(
        str(number),
        point,
        (-7, 0),
        textcoords="offset points",
        ha="right",
        va="center",
        fontsize=9,
    )


def error_curves(rows: pd.DataFrame, title: str) -> Figure:
    """Return a picture of the error along the numbers of `cross`, a panel for each protocol.

    Each variant is a line. The names in `cross` begin with a number, as in `8 recordings`. The
    number is the place on the axis, and the other words label it.

    Args:
        rows: see `comparison.rows_of`.
        title: text above the panels.
    """
    rows = with_numbers(rows)
    numbers = rows["number"].unique()
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
        # the unit of the largest number is in the plural
        axes.set(title=protocol, xlabel=rows.loc[rows["number"].idxmax(), "unit"])
        axes.set_xscale("log")
        axes.xaxis.set(minor_locator=NullLocator())
        axes.set_xticks(numbers, numbers.astype(str))
        axes.grid(alpha=0.3)
    _finish(figure, title)
    return figure


def with_numbers(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows with the parts of names such as `A / 8 recordings` in three columns.

    Args:
        rows: rows of a study that crosses variants with numbers.

    Returns:
        The rows with the columns `name`, `number` and `unit`, such as `A`, 8 and `recordings`.
    """
    rows = rows.join(rows["variant"].str.extract(r"(?P<name>.*) / (?P<number>\d+) ?(?P<unit>.*)"))
    return rows.assign(number=rows["number"].astype(int))


def learning_curve(rows: pd.DataFrame, labels: Mapping[str, str]) -> Figure:
    """Return one panel with the error on whole recordings by the number of training frames.

    Each line has its label at its right end. The bars are the intervals of the results file. A mark
    is hollow if a network is not trained to its end.

    Args:
        rows: rows of a results file, see `comparison.rows_of`.
        labels: labels of the lines, by the first part of the variants' names. Other variants are
            not drawn.
    """
    rows = with_numbers(rows[rows["protocol"] == TITLES[WHOLE]])
    figure = Figure(figsize=(6.4, 3.9), layout="constrained")
    axes = figure.subplots()
    for name, label in labels.items():
        curve = rows[rows["name"] == name].sort_values("number")
        if curve.empty:
            continue
        (line, *_) = axes.errorbar(
            curve["number"], curve["error"], _bars(curve), fmt="o-", ms=4, elinewidth=0.8
        )
        untrained = curve[~curve["trained"]]
        axes.plot(
            untrained["number"],
            untrained["error"],
            "o",
            color=line.get_color(),
            markerfacecolor="white",
            ms=6,
            zorder=3,
        )
        end = curve.iloc[-1]
        axes.annotate(
            label,
            (end["number"], end["error"]),
            (8, 0),
            textcoords="offset points",
            va="center",
            color=line.get_color(),
            weight="bold",
        )
    numbers = rows["number"].unique()
    axes.set_xscale("log")
    axes.xaxis.set(minor_locator=NullLocator())
    axes.set_xticks(numbers, numbers.astype(str))
    axes.set_xlim(numbers.min() * 0.85, numbers.max() * 3.2)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("training frames of each object")
    axes.set_ylabel("whole recordings wrong, %")
    axes.grid(alpha=0.3)
    for side in ("right", "top"):
        axes.spines[side].set_visible(False)
    return figure


def _finish(figure: Figure, title: str, **legend: float) -> None:
    """Label the errors, and put the first panel's legend below all panels."""
    figure.axes[0].set_ylabel("error, %")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9, **legend)
    figure.suptitle(title, fontsize=10)


def _bars(rows: pd.DataFrame) -> np.ndarray:
    """Return the lengths (2, n) of the intervals below and above the errors.

    A length is NaN, which draws nothing, if there is no interval.
    """
    ends = rows[["low", "error", "high"]].to_numpy().T
    lengths: np.ndarray = np.diff(ends, axis=0).clip(0)
    return lengths
