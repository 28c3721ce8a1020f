"""The pipeline's row in MLflow: what it has besides params.yaml."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tactile_viewgcn.evaluation import live
from tactile_viewgcn.evaluation.earlier_stages import Records
from tactile_viewgcn.evaluation.results import errors_by_frames
from tactile_viewgcn.evaluation.trials import WHOLE, Predictions
from tactile_viewgcn.schema import flatten
from tactile_viewgcn.tables.frames import Frames

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZES = ("classes", "frames", "recordings", "groups")  # of metrics.json


@dataclass(frozen=True)
class Row:
    """Content of the pipeline's row.

    Attributes:
        tags: the ids of the stages' runs, and what `auto` chose.
        parameters: numbers of classes, of frames, recordings and split groups, and of weights.
        metrics: name, value and step: the summary, the seconds of each stage and the peak memory
            at step 0; the error of each trial, numbered from 1; the error by number of frames.
    """

    tags: dict[str, str]
    parameters: dict[str, float]
    metrics: list[tuple[str, float, int]]


def row_of(
    predictions: Predictions,
    metrics: dict[str, Any],
    timing: dict[str, Any],
    numbers: dict[str, float],
    records: Records,
) -> Row:
    """Return the content of the pipeline's row.

    Args:
        predictions: all answers.
        metrics: content of metrics.json.
        timing: content of timing.json.
        numbers: content of summary.json.
        records: of the earlier stages.
    """
    tags: dict[str, str] = {}
    parameters: dict[str, float] = flatten({name: metrics[name] for name in SIZES})
    for stage, record in records.items():
        if record.run_id:
            tags[f"stage.{stage}"] = record.run_id
        for name, value in record.counts.items():
            if name.startswith("resolved."):
                tags[name] = str(value)
            elif name.startswith("weights."):
                parameters[name] = value
    return Row(tags, parameters, _metrics(predictions, metrics, timing, numbers))


def _metrics(
    predictions: Predictions,
    metrics: dict[str, Any],
    timing: dict[str, Any],
    numbers: dict[str, float],
) -> list[tuple[str, float, int]]:
    """Return name, value and step of each number."""
    costs = flatten({name: timing[name] for name in ("seconds", "peak_mb")})
    values = [(name, value, 0) for name, value in (numbers | costs).items()]
    for protocol, trials in predictions.trials.items():
        for trial, error in enumerate(trials.errors.tolist(), start=1):
            values.append((f"trials.error.{protocol}", error, trial))
    for protocol, errors in errors_by_frames(metrics).items():
        for frames, interval in errors:
            values.append((f"views.error.{protocol}", interval["mean"], frames))
    return values


def figures_of(predictions: Predictions, rows: list[live.Row]) -> dict[str, "Figure"]:
    """Return the pictures of a pipeline, by the names of their files.

    Args:
        predictions: all answers.
        rows: of live.csv.
    """
    from tactile_viewgcn import plots  # here, since it loads Matplotlib

    whole = predictions.trials[WHOLE]
    counts = whole.confusion(len(predictions.classes))
    figures = {"confusion.png": plots.confusion(counts, predictions.classes.tolist())}
    if rows:
        figures["live.png"] = plots.live_errors(rows, whole.chance)
    return figures


def model_metadata(table: Frames, views: int) -> dict[str, Any]:
    """Return what MLflow shows of the model: its classes, its views, and frames that it takes."""
    return {
        "classes": table.classes,
        "views": views,
        "shape": list(table.live.shape),
        "dtype": str(table.counts.dtype),
    }
