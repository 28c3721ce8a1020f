"""The picture of a study: errors with their intervals, an arm a line, or against the seconds they took to train."""

import csv

import click
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stages.command import INPUT, OUTPUT, stage
from studies.results import named
from tactile_viewgcn.files import whole

COLOURS = {"object": "C0", "recording": "C1"}


@stage("data")
@click.option("--results", type=INPUT, required=True, help="results.csv of a study.")
@click.option("--against", type=click.Choice(["arm", "seconds"]), default="arm", show_default=True)
@click.option("--title", required=True)
@click.option("--out", type=OUTPUT, required=True)
def picture(params, run, results, against, title, out):
    """Draw the results of a study."""
    with results.open(newline="") as file:
        rows = list(csv.DictReader(file))
    figure = by_arm(rows) if against == "arm" else by_seconds(rows)
    figure.suptitle(f"{named(params.data)}: {title}\nBars: 95 % interval over split groups")
    with whole(out) as part:
        figure.savefig(part, format="png", dpi=110)
    run.artifact(out)


def by_arm(rows: list[dict[str, str]]) -> Figure:
    """A line for each arm, a mark on it for each protocol."""
    arms, protocols = list(dict.fromkeys(row["arm"] for row in rows)), dict.fromkeys(row["protocol"] for row in rows)
    figure = Figure(figsize=(8, 1.6 + 0.42 * len(arms)), layout="constrained")
    axes = figure.add_subplot()
    for number, protocol in enumerate(protocols):
        own = [row for row in rows if row["protocol"] == protocol]
        lines = [arms.index(row["arm"]) + 0.2 * (number - (len(protocols) - 1) / 2) for row in own]
        _errors(axes, own, lines, COLOURS[protocol], f"{protocol} protocol", upright=False)
    axes.set_yticks(range(len(arms)), arms)
    axes.set(xlabel="error, %", ylim=(len(arms) - 0.5, -0.5))
    axes.grid(alpha=0.3, axis="x")
    axes.legend(fontsize=8)
    return figure


def by_seconds(rows: list[dict[str, str]]) -> Figure:
    """Error under the last protocol of the table against the seconds of fine-tuning, and against those of an answer."""
    protocol = rows[-1]["protocol"]
    own = [row for row in rows if row["protocol"] == protocol]
    figure = Figure(figsize=(12, 6), layout="constrained")
    for axes, cost, label in zip(
        figure.subplots(1, 2, sharey=True),
        ("finetune s", "ms in batches"),
        ("seconds of fine-tuning", "ms per view set, in batches of 256"),
        strict=True,
    ):
        known = [(number, row) for number, row in enumerate(own) if row[cost]]
        for number, row in known:
            _errors(axes, [row], [float(row[cost])], f"C{number % 10}", row["arm"], upright=True)
            place = (float(row[cost]), float(row["error"]))
            axes.annotate(row["arm"], place, (4, 4), textcoords="offset points", fontsize=7, color=f"C{number % 10}")
        axes.set_xscale("symlog" if any(not float(row[cost]) for _, row in known) else "log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("{x:g}")
        axes.tick_params(axis="x", which="both", labelsize=7)
        axes.set(xlabel=label, ylabel=f"error, % ({protocol} protocol)")
        axes.grid(alpha=0.3)
    return figure


def _errors(
    axes: Axes, rows: list[dict[str, str]], places: list[float], colour: str, label: str, *, upright: bool
) -> None:
    """Errors with their intervals, where they are known, at these places of the other axis."""
    errors = [float(row["error"]) for row in rows]
    bars = None
    if all(row["low"] for row in rows):
        bars = [
            [max(0.0, error - float(row["low"])) for error, row in zip(errors, rows, strict=True)],
            [max(0.0, float(row["high"]) - error) for error, row in zip(errors, rows, strict=True)],
        ]
    across, up = (places, errors) if upright else (errors, places)
    axes.errorbar(
        across, up, **{"yerr" if upright else "xerr": bars}, fmt="o", color=colour, elinewidth=0.8, label=label
    )


if __name__ == "__main__":
    picture()
