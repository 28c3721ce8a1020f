"""Writes the results of `evaluate`: metrics, tables, the summary for DVC, and lines of text."""

import json
from pathlib import Path
from typing import Any

from tactile_viewgcn.evaluation.live import COLUMNS, Row, live_line
from tactile_viewgcn.evaluation.trials import (
    PROTOCOLS,
    TITLES,
    WHOLE,
    Predictions,
    write_predictions,
)
from tactile_viewgcn.files import new_files
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.messages import NEW_SESSION, csv_text, several

# Titles of the scores by their names in metrics.json, where only `new_session` can be missing.
# Pages list the scores in this order, the terminal in reverse order.
SCORED = {
    WHOLE: TITLES[WHOLE],
    "new_session": NEW_SESSION,
    "recording": TITLES["recording"],
    "object": TITLES["object"],
}


def summary(metrics: dict[str, Any], timing: dict[str, Any]) -> dict[str, float]:
    """Return the numbers that runs are compared by.

    Args:
        metrics: content of metrics.json.
        timing: content of timing.json.

    Returns:
        By name: error rates as fractions, the seconds of all stages together, and the milliseconds
            per answer.
    """
    names = [name for name in SCORED if name in metrics]
    numbers = {f"error.{name}": metrics[name]["error"]["mean"] for name in names}
    for name in names:
        if "top3_error" in metrics[name]:
            numbers[f"top3_error.{name}"] = metrics[name]["top3_error"]
    numbers["seconds.total"] = timing["seconds"]["total"]
    numbers["ms_per_answer"] = timing["latency_ms"]["single"]["median"]
    numbers["ms_per_recording"] = timing["latency_ms"][WHOLE]["median"]
    return numbers


def errors_by_frames(metrics: dict[str, Any]) -> dict[str, list[tuple[int, dict[str, Any]]]]:
    """Return pairs of a number of frames and its error, by protocol.

    The last pair of `recording` stands for whole recordings, with their median number of frames.

    Args:
        metrics: content of metrics.json.
    """
    errors = {}
    for protocol in PROTOCOLS:
        by_frames = list(metrics[protocol]["by_views"].items())
        if protocol == "recording":
            by_frames += metrics[WHOLE]["by_views"].items()
        errors[protocol] = [(int(frames), error) for frames, error in by_frames]
    return errors


def write_results(
    folder: Path,
    predictions: Predictions,
    metrics: dict[str, Any],
    timing: dict[str, Any],
    numbers: dict[str, float],
    live: list[Row],
) -> None:
    """Write all files of the results except the record.

    On every run with one seed all numbers are equal, except the costs. DVC shows summary.json,
    which has errors and costs.

    Args:
        folder: the folder of the files.
        predictions: all answers, for predictions.npz and the tables.
        metrics: content of metrics.json.
        timing: content of timing.json.
        numbers: content of summary.json.
        live: rows of live.csv.
    """
    trees = {"metrics": metrics, "timing": timing, "summary": numbers}
    tables: dict[str, list[Any]] = {
        "trials": _trials_table(predictions),
        "views": _views_table(metrics),
        "confusion": _confusion_table(predictions),
        "per_class": _classes_table(predictions),
        "live": [COLUMNS, *([row[name] for name in COLUMNS] for row in live)],
    }
    with new_files(folder) as part:
        write_predictions(part / "predictions.npz", predictions)
        for name, tree in trees.items():
            (part / f"{name}.json").write_text(json.dumps(tree, indent=2) + "\n")
        for name, rows in tables.items():
            (part / f"{name}.csv").write_text(csv_text(rows), "utf-8", newline="")


def _trials_table(predictions: Predictions) -> list[list[Any]]:
    """Return the error of each trial, numbered from 0."""
    rows: list[list[Any]] = [["protocol", "trial", "error"]]
    for protocol, trials in predictions.trials.items():
        for trial, error in enumerate(trials.errors.tolist()):
            rows.append([protocol, trial, error])
    return rows


def _views_table(metrics: dict[str, Any]) -> list[list[Any]]:
    """Return the errors by number of frames, with their intervals."""
    rows: list[list[Any]] = [["protocol", "views", "error", "low", "high"]]
    for protocol, errors in errors_by_frames(metrics).items():
        for frames, error in errors:
            rows.append([protocol, frames, error["mean"], error["low"], error["high"]])
    return rows


def _confusion_table(predictions: Predictions) -> list[list[Any]]:
    """Return how often each class was answered for each true class, over all trials."""
    rows: list[list[Any]] = [["protocol", "object", "predicted", "count"]]
    classes = predictions.classes.tolist()
    for protocol, trials in predictions.trials.items():
        confusion = trials.confusion(len(classes)).tolist()
        for label, counts in zip(classes, confusion, strict=True):
            for answer, count in zip(classes, counts, strict=True):
                rows.append([protocol, label, answer, count])
    return rows


def _classes_table(predictions: Predictions) -> list[list[Any]]:
    """Return the error of each class that was tested, over all trials."""
    rows: list[list[Any]] = [["protocol", "object", "answers", "error"]]
    classes = predictions.classes.tolist()
    for protocol, trials in predictions.trials.items():
        confusion = trials.confusion(len(classes)).tolist()
        for label, counts in enumerate(confusion):
            answers = sum(counts)
            if answers:
                rows.append([protocol, classes[label], answers, 1 - counts[label] / answers])
    return rows


def summary_lines(metrics: dict[str, Any], timing: dict[str, Any], live: list[Row]) -> list[str]:
    """Return the lines that the stage prints: the tested sets, errors with intervals, and costs.

    Args:
        metrics: content of metrics.json.
        timing: content of timing.json.
        live: rows of live.csv.
    """
    names = [name for name in reversed(SCORED) if name in metrics]
    lines = [_tested_line(metrics), *(_score_line(name, metrics[name]) for name in names)]
    if live:
        lines.append(live_line(live))
    return [*lines, *_cost_lines(timing)]


def _tested_line(metrics: dict[str, Any]) -> str:
    """Return a line with the sizes of the tested set."""
    (side,) = metrics["groups"]
    sizes = [
        f"{several(metrics['frames'][side], 'view set')} of {metrics['views']}",
        several(metrics["recordings"][side], "recording"),
        several(metrics["classes"], "class", "classes"),
        several(metrics["trials"], "trial"),
        several(metrics["groups"][side], "group"),
    ]
    return f"evaluate on the {side} set: {', '.join(sizes)}"


def _score_line(name: str, score: dict[str, Any]) -> str:
    """Return a line with one score of `SCORED`."""
    error = score["error"]
    line = (
        f"  {SCORED[name]}: error {percent_interval(error['mean'], error['low'], error['high'])} %"
    )
    if name in PROTOCOLS:
        line += f", std over trials {100 * error['std']:.1f}"
    if "top3_error" in score:
        line += f", top-3 error {100 * score['top3_error']:.1f} %"
    return line


def _cost_lines(timing: dict[str, Any]) -> list[str]:
    """Return lines with the seconds of the stages, the latency and the peak memory."""
    seconds = [f"{stage} {value:,.1f} s" for stage, value in timing["seconds"].items()]
    latency = timing["latency_ms"]
    return [
        f"  time: {', '.join(seconds)}",
        f"  per answer: {latency['single']['median']:.2f} ms for a single one "
        f"(95th percentile {latency['single']['p95']:.2f}), "
        f"{latency['batch']['median']:.2f} ms in batches, "
        f"{latency[WHOLE]['median']:.2f} ms a whole recording; "
        f"peak memory {timing['peak_mb']:,.0f} MB",
    ]
