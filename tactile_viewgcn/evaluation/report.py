"""What evaluate leaves behind: metrics, costs, tables, the row in MLflow and `dvc exp show`, and lines of text."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.evaluation.evaluate import Evaluation
from tactile_viewgcn.evaluation.trials import PROTOCOLS, TOP
from tactile_viewgcn.files import atomic_write, readable
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.names import write_csv
from tactile_viewgcn.notes import several
from tactile_viewgcn.schema import flatten
from tactile_viewgcn.tables.frames import SIDES, Frames

RECORD = ("stage", "run_id", "seconds", "peak_mb", "inputs", "counts")  # what a stage writes of its run
DIGEST = 8  # of an md5's digits, as many as MLflow has in a digest
Records = dict[str, dict[str, Any]]  # of the earlier stages, by stage


def metrics_tree(evaluation: Evaluation, table: Frames, views: int, side: str) -> dict[str, Any]:
    """Sizes and scores of an evaluation on a side, equal on every run with one seed; errors are fractions."""
    sides = {name: table.on(SIDES.index(name)) for name in ("train", side)}
    frames = {name: int(table.anchor[index].sum()) for name, index in sides.items()}
    frames |= {f"kept_{name}": len(index) for name, index in sides.items()}
    return {
        "views": views,
        "classes": len(table.classes),
        "trials": len(next(iter(evaluation.protocols.values())).correct),
        "frames": frames,
        "groups": {side: len(np.unique(evaluation.groups))},
        **evaluation.scores,
    }


def read_records(paths: Iterable[Path]) -> Records:
    """The records of earlier stages, by stage.

    Raises:
        UserError: a record is damaged, or of another version.
    """
    records = {}
    for path in paths:
        with readable(path):
            record = json.loads(path.read_text())
            records[record["stage"]] = {name: record[name] for name in RECORD}
    return records


def costs(evaluation: Evaluation, records: Records, seconds: float, peak_mb: float) -> dict[str, Any]:
    """Seconds of each stage and of all, latency in ms per view set, and the peak memory of the hungriest stage in MB.

    Args:
        seconds, peak_mb: of the stage `evaluate` itself, of whose seconds the trials took `trials_seconds`.
    """
    each = {name: record["seconds"] for name, record in records.items()} | {"evaluate": seconds}
    peak = max([peak_mb, *(record["peak_mb"] for record in records.values())])
    return {
        "seconds": {name: round(value, 3) for name, value in (each | {"total": sum(each.values())}).items()},
        "trials_seconds": round(evaluation.seconds, 3),
        "latency_ms": evaluation.latency_ms,
        "peak_mb": round(peak, 1),
    }


def summary(metrics: dict[str, Any], timing: dict[str, Any]) -> dict[str, Any]:
    """The few numbers that runs are compared by: errors as fractions, seconds of all stages, ms per view set."""
    scores = {name: metrics[name] for name in ("recording", "object", "sequential") if name in metrics}
    return {
        "error": {name: score["error"]["mean"] for name, score in scores.items()},
        "top3_error": {name: score["top3_error"] for name, score in scores.items() if "top3_error" in score},
        "seconds": {"total": timing["seconds"]["total"]},
        "ms_per_view_set": timing["latency_ms"]["single"]["median"],
    }


def write_results(folder: Path, metrics: dict, timing: dict, evaluation: Evaluation, classes: list[str]) -> None:
    """Write metrics.json and the tables of trials, views, confusion and classes, equal with one seed; and the costs.

    The costs are timing.json and those in summary.json, which DVC shows.
    """
    for name, tree in (("metrics", metrics), ("timing", timing), ("summary", flatten(summary(metrics, timing)))):
        with atomic_write(folder / f"{name}.json") as part:
            part.write_text(json.dumps(tree, indent=2) + "\n")
    trials: list[list] = [["protocol", "trial", "error", "top3_error"]]
    views: list[list] = [["protocol", "views", "error", "low", "high"]]
    confusion: list[list] = [["protocol", "object", "predicted", "count"]]
    per_class: list[list] = [["protocol", "object", "view_sets", "error"]]
    for protocol, each in evaluation.protocols.items():
        for number, (correct, in_top3) in enumerate(zip(each.correct, each.in_top3, strict=True)):
            trials.append([protocol, number, float(1 - correct.mean()), float(1 - in_top3.mean())])
        for count, error in errors_by_views(metrics, protocol).items():
            views.append([protocol, count, error["mean"], error["low"], error["high"]])
        counts = evaluation.confusion(protocol, len(classes))
        for label, (name, row) in enumerate(zip(classes, counts, strict=True)):
            confusion += [[protocol, name, other, int(count)] for other, count in zip(classes, row, strict=True)]
            if view_sets := int(row.sum()):
                per_class.append([protocol, name, view_sets, float(1 - row[label] / view_sets)])
    tables = {"trials": trials, "views": views, "confusion": confusion, "per_class": per_class}
    for name, rows in tables.items():
        with atomic_write(folder / f"{name}.csv") as part, part.open("w", newline="") as file:
            write_csv(file, rows)


def errors_by_views(metrics: dict[str, Any], protocol: str) -> dict[str, dict[str, Any]]:
    """Errors by the number of views: of V alone, where the classifier was asked for no fewer."""
    score = metrics[protocol]
    return score.get("by_views", {str(metrics["views"]): score["error"]})


def row_metrics(metrics: dict[str, Any], timing: dict[str, Any]) -> dict[str, float]:
    """The summary, the seconds of each stage and the peak memory, by dotted key."""
    return flatten(summary(metrics, timing)) | flatten({name: timing[name] for name in ("seconds", "peak_mb")})


def row_tags(metrics: dict[str, Any], records: Records) -> dict[str, str]:
    """Errors with their intervals in words, what `auto` chose, and the other stages' runs."""
    scores = {name: metrics[name] for name in PROTOCOLS if name in metrics}
    errors = {
        f"error.{name}.percent": error_text(score["error"]) + joined_text(score) for name, score in scores.items()
    }
    runs = {f"stage.{name}": record["run_id"] for name, record in records.items() if record["run_id"]}
    counts = {name: str(value) for record in records.values() for name, value in record["counts"].items()}
    chosen = {name: value for name, value in counts.items() if name.startswith("resolved.")}
    return errors | runs | chosen


def row_constants(metrics: dict[str, Any], records: Records) -> dict[str, float]:
    """Numbers of classes, of frames and groups on each side, and of weights: constants, not results."""
    sizes = flatten({name: metrics[name] for name in ("classes", "frames", "groups")})
    weights = {name: value for record in records.values() for name, value in record["counts"].items()}
    return sizes | {name: value for name, value in weights.items() if name.startswith("weights.")}


def dataset(records: Records, frames: str, md5: str) -> tuple[str, str]:
    """Path and digest of the recordings; of the table of frames where there is no record of ingest."""
    source = records["ingest"]["inputs"]["source"] if "ingest" in records else {"path": frames, "md5": md5}
    return source["path"], source["md5"][:DIGEST]


def summary_lines(metrics: dict, timing: dict) -> list[str]:
    """What was tested, the error in per cent under each protocol with its interval, and what it cost."""
    latency, ((side, groups),) = timing["latency_ms"], metrics["groups"].items()
    lines = [
        f"evaluate: {several(metrics['frames'][side], 'view set')} of {metrics['views']}, "
        f"{several(metrics['classes'], 'class', 'classes')}, {several(metrics['trials'], 'trial')}, "
        f"{several(groups, 'group')}" + (" of the validation side" if side == "validation" else "")
    ]
    scores = {name: metrics[name] for name in PROTOCOLS if name in metrics}
    for protocol, score in scores.items():
        top3 = f", top-3 error {100 * score['top3_error']:.1f} %" if metrics["classes"] > TOP else ""
        lines.append(
            f"  {protocol} protocol{joined_text(score)}: error {error_text(score['error'])} %, std over trials "
            f"{100 * score['error']['std']:.1f}{top3}"
        )
    if "by_views" in score:  # of the last protocol, which is the user's
        errors = ", ".join(f"{count}: {100 * error['mean']:.1f}" for count, error in score["by_views"].items())
        lines.append(f"  by views ({protocol}): {errors} %")
    if "sequential" in metrics:
        score = metrics["sequential"]
        lines.append(
            f"  sequential: error {error_text(score['error'])} % at a mean of {score['frames']:.2f} frames, "
            f"stopping at {score['confidence_threshold']:g}"
        )
    times = ", ".join(f"{name} {value:,.1f} s" for name, value in timing["seconds"].items())
    return [
        *lines,
        f"  time: {times}; the trials {timing['trials_seconds']:,.1f} s",
        f"  per view set: {latency['single']['median']:.2f} ms alone (95th percentile "
        f"{latency['single']['p95']:.2f}), {latency['batch']['median']:.2f} ms in batches; "
        f"peak memory {timing['peak_mb']:,.0f} MB",
    ]


def joined_text(score: dict[str, Any]) -> str:
    """The words ` of 2 grasps` for a score of metrics.json whose view sets join so many; else nothing."""
    return "".join(f" of {several(count, unit)}" for unit, count in score.get("joined", {}).items())


def error_text(error: dict[str, Any]) -> str:
    """An error of metrics.json and its 95 % interval in per cent: 48.2 (39.0 to 57.8)."""
    return percent_interval(error["mean"], error["low"], error["high"])
