"""The pipeline's row in MLflow: its content besides params.yaml, and how it is logged."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_viewgcn.evaluation import live
from tactile_viewgcn.evaluation.finished_run import FinishedRun
from tactile_viewgcn.evaluation.results import SCORED, errors_by_frames
from tactile_viewgcn.evaluation.trials import Predictions
from tactile_viewgcn.evaluation.versus import VersusHead
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.provenance import EARLIER, ROW
from tactile_viewgcn.schema import flatten
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.tracking import Run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DIGITS = 4  # decimals of the numbers that MLflow's table shows
SIZES = ("classes", "frames", "recordings", "groups")  # entries of metrics.json


@dataclass(frozen=True)
class Row:
    """The content of the pipeline's row.

    Attributes:
        tags: the ids of the stages' runs, what `auto` chose, and the comparison with the run of the
            commit.
        parameters: the numbers of classes, frames, recordings, split groups and weights.
        metrics: name, value and step of each number. Step 0 has the summary, the seconds of each
            stage and the peak memory. The step of a trial's error is the trial, counted from 1. The
            step of an error by number of frames is this number.
    """

    tags: dict[str, str]
    parameters: dict[str, float]
    metrics: list[tuple[str, float, int]]


def log_row(
    run: Run,
    finished: FinishedRun,
    numbers: dict[str, float],
    versus: VersusHead | None,
    *,
    model: Path,
    table: Frames,
    page: Callable[[FinishedRun], str],
    card: Callable[[FinishedRun], str],
) -> list[str]:
    """Log the pipeline's row to MLflow: data set, model and its card, numbers, pictures, report.

    Args:
        run: the run in MLflow.
        finished: the finished run, with its results.
        numbers: content of summary.json.
        versus: the comparison with the run of the commit; None if they cannot be compared.
        model: file of the classifier.
        table: frames that the classifier was trained and tested on.
        page: function that returns the report's page as HTML.
        card: function that returns the model card as Markdown.

    Returns:
        Lines for the terminal: how a program loads the model, and where MLflow shows the row. There
            are no lines if nothing is logged.
    """
    if not run.id:
        return []
    if "ingest" in finished.records:
        source = finished.records["ingest"].inputs["source"]
        run.dataset(source["path"], source["md5"][:8])
    name = finished.records[ROW].name or ROW
    metadata = model_metadata(table, finished.metrics["views"])
    address = run.model(name, model, metadata)
    row = row_of(finished, numbers, versus)
    run.batch(row.tags, row.parameters, row.metrics, model=address)

    named = replace(finished, name=run.id or "")
    run.pages(figures_of(finished.predictions, finished.live), {"report.html": page(named)})
    if address:
        run.card(address, card(named))
    run.description = description(finished, name)
    lines = list[str]()
    if address:
        lines.append(f"  in a program: mlflow.pyfunc.load_model({address!r})")
    if run.table:
        lines.append(f"  in a table with other runs: {run.table}")
    return lines


def row_of(run: FinishedRun, numbers: dict[str, float], versus: VersusHead | None) -> Row:
    """Return the content of the pipeline's row.

    Args:
        run: the finished run.
        numbers: content of summary.json.
        versus: the comparison with the run of the commit; None if they cannot be compared.
    """
    tags: dict[str, str] = {}
    if versus:
        tags["versus.head"] = versus.text
    parameters: dict[str, float] = flatten({name: run.metrics[name] for name in SIZES})
    for stage in EARLIER:
        record = run.records.get(stage)
        if not record:
            continue
        if record.run_id:
            tags[f"stage.{stage}"] = record.run_id
        for name, value in record.counts.items():
            if name.startswith("resolved."):
                tags[name] = str(value)
            elif name.startswith("weights."):
                parameters[name] = value
    return Row(tags, parameters, _metrics(run, numbers))


def _metrics(run: FinishedRun, numbers: dict[str, float]) -> list[tuple[str, float, int]]:
    """Return name, value and step of each number."""
    costs = flatten({name: run.timing[name] for name in ("seconds", "peak_mb")})
    ends = dict[str, float]()
    for name in SCORED:
        error = run.metrics.get(name, {}).get("error", {})
        for end in ("low", "high"):
            if error.get(end) is not None:
                ends[f"error.{name}.{end}"] = error[end]
    # MLflow's table cuts off longer numbers
    values = [(name, round(value, DIGITS), 0) for name, value in (numbers | ends | costs).items()]
    for protocol, trials in run.predictions.trials.items():
        for trial, error in enumerate(trials.errors.tolist(), start=1):
            values.append((f"trials.error.{protocol}", error, trial))
    for protocol, errors in errors_by_frames(run.metrics).items():
        for frames, interval in errors:
            values.append((f"views.error.{protocol}", interval["mean"], frames))
    return values


def description(run: FinishedRun, name: str) -> str:
    """Return what the row's page says first: the run, its error, its time, and the next command.

    Args:
        run: the finished run.
        name: of the row.
    """
    error = run.score["error"]
    interval = percent_interval(error["mean"], error["low"], error["high"])
    seconds = run.timing["seconds"]["total"]
    text = f"**{name}**: {interval} % error on whole recordings, {seconds:,.0f} s"
    return f"{text}.\n\n`tactile-viewgcn report {run.records[ROW].run_id}`"


def figures_of(predictions: Predictions, rows: list[live.Row]) -> dict[str, "Figure"]:
    """Return the pictures of a pipeline, by the names of their files.

    Args:
        predictions: all answers.
        rows: rows of live.csv, possibly none.
    """
    from tactile_viewgcn import plots  # here, since it loads Matplotlib

    whole = predictions.whole
    counts = whole.confusion(len(predictions.classes))
    figures = {"confusion.png": plots.confusion(counts, predictions.classes.tolist())}
    if rows:
        figures["live.png"] = plots.live_errors(rows, whole.chance)
    return figures


def model_metadata(table: Frames, views: int) -> dict[str, Any]:
    """Return what MLflow shows of the model: its classes, its views, and the frames it takes."""
    return {
        "classes": table.classes,
        "views": views,
        "shape": list(table.live.shape),
        "dtype": str(table.counts.dtype),
    }
