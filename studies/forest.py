"""The forest plot of the paper's claims: a row for each claim and design, in percentage points."""

from collections.abc import Iterator

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from studies.comparison import HIGHER, LOWER, OPEN
from studies.findings import CLAIMED, CLAIMS, DESIGNS, Claim, Design, has, row

DECIDED = (HIGHER, LOWER, OPEN)  # only five worlds and trained networks have these verdicts
REAL = "C1"
SIMULATED = "C0"


def rows_of_claims() -> Iterator[tuple[Claim, Design, "pd.Series[float]"]]:
    """Yield every claim and design that has been measured, with its row of the results file."""
    for claim in CLAIMS:
        for design in DESIGNS:
            variant = f"{claim.variant}{design.suffix}"
            if has(design.study, variant, CLAIMED):
                yield claim, design, row(design.study, variant, CLAIMED)


def forest_plot() -> Figure:
    """Return the plot: x is the error under `object` minus the recipe's error in the same design.

    A thick bar is the 95 % interval over recordings, and a thin bar the interval over seeds. A
    diamond is the published value. A mark is hollow if the difference has no verdict: with fewer
    than five seeds, in one simulated world, or for a network that is not trained to its end. See
    `comparison.verdict`.
    """
    measured = list(rows_of_claims())
    published = [claim for claim in CLAIMS if claim.published is not None]
    lines = len(measured) + len(published) + 2 * len(CLAIMS)
    figure = Figure(figsize=(7.2, 1.2 + 0.225 * lines), layout="constrained")
    axes = figure.subplots()
    height = 0
    for claim in CLAIMS:
        _write(axes, height, claim.label, weight="bold")
        height += 1
        if claim.published is not None:
            _write(axes, height, "published, STAG's data")
            axes.plot(claim.published, height, "D", color="black", ms=6)
            height += 1
        for _, design, result in (entry for entry in measured if entry[0] is claim):
            _draw(axes, height, design, result)
            height += 1
        height += 1
    axes.axvline(0, color="0.3", lw=0.8)
    axes.grid(axis="x", alpha=0.3)
    axes.set_ylim(height - 1.2, -0.8)
    axes.set_yticks([])
    axes.set_xlabel(
        "percentage points of error above the recipe of the same design, object protocol\n"
        "(right of 0 the paper's recipe is better)",
        fontsize=9,
        loc="right",
    )
    for side in ("left", "right", "top"):
        axes.spines[side].set_visible(False)
    _explain(figure, has_real=any(design.is_real for _, design, _ in measured))
    return figure


def _draw(axes: Axes, height: float, design: Design, result: "pd.Series[float]") -> None:
    """Draw a row: label, interval over seeds, interval over recordings, and the difference."""
    head = f"vs {design.reference} "
    color = REAL if design.is_real else SIMULATED
    _write(axes, height, design.label)
    if pd.notna(result[f"{head}seeds_low"]):
        ends = [result[f"{head}seeds_low"], result[f"{head}seeds_high"]]
        axes.plot(ends, [height, height], color=color, lw=1.2)
    axes.plot([result[f"{head}low"], result[f"{head}high"]], [height, height], color=color, lw=4.5)
    fill = color if result[f"{head}verdict"] in DECIDED else "white"
    axes.plot(result[f"{head}more"], height, "o", color=color, markerfacecolor=fill, ms=7, zorder=3)


def _write(axes: Axes, height: float, text: str, weight: str = "normal") -> None:
    """Write a text to the left of a row."""
    axes.annotate(
        text,
        (0, height),
        (-6, 0),
        xycoords=axes.get_yaxis_transform(),
        textcoords="offset points",
        ha="right",
        va="center",
        fontsize=9,
        weight=weight,
    )


def _explain(figure: Figure, *, has_real: bool) -> None:
    """Put the legend below the plot; real recordings are in it if there are any."""
    entries = [
        Line2D([], [], color=SIMULATED, lw=4.5, label="simulated: 95 % over recordings"),
        Line2D([], [], color=SIMULATED, lw=1.2, label="simulated: 95 % over seeds"),
        Line2D([], [], color=SIMULATED, marker="o", ls="", label="five seeds and worlds, trained"),
        Line2D(
            [],
            [],
            color=SIMULATED,
            marker="o",
            markerfacecolor="white",
            ls="",
            label="no verdict: fewer, or not trained",
        ),
        Line2D([], [], color="black", marker="D", ls="", label="published, STAG's data"),
    ]
    if has_real:
        entries.append(Line2D([], [], color=REAL, marker="o", ls="", label="real recordings"))
    figure.legend(handles=entries, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
