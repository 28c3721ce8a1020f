"""What evaluate leaves behind: metrics, timings, tables, and a summary in five lines."""

import csv
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.evaluation.evaluate import Evaluation
from tactile_viewgcn.files import atomic_write, readable
from tactile_viewgcn.frames.split import SIDES
from tactile_viewgcn.tables.frames import Frames

RECORD = ("stage", "run_id", "seconds", "peak_mb", "inputs", "counts")  # what a stage writes of its run


def metrics_tree(evaluation: Evaluation, table: Frames, views: int, side: str = "test") -> dict[str, Any]:
    """Sizes and scores of an evaluation on a side, equal on every run with one seed; accuracies are fractions."""
    groups = evaluation.groups
    sides = {name: table.on(SIDES.index(name)) for name in ("train", side)}
    frames = {name: int(table.anchor[index].sum()) for name, index in sides.items()}
    frames |= {f"kept_{name}": len(index) for name, index in sides.items()}
    return {
        "views": views,
        "classes": len(table.classes),
        "trials": evaluation.trials,
        "frames": frames,
        "groups": {side: len(np.unique(groups))},
    } | evaluation.scores


def read_records(paths: Iterable[Path]) -> dict[str, dict]:
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


def costs(evaluation: Evaluation, records: dict[str, dict], seconds: float, peak_mb: float) -> dict[str, Any]:
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


def write_costs(folder: Path, timing: dict, summary: dict) -> None:
    """timing.json, and summary.json, which DVC shows."""
    _json(folder / "timing.json", timing)
    _json(folder / "summary.json", summary)


def write_results(folder: Path, metrics: dict, evaluation: Evaluation, classes: list[str]) -> None:
    """metrics.json, trials.csv, confusion.csv and per_class.csv: the same on every run with one seed."""
    _json(folder / "metrics.json", metrics)
    trials = evaluation.protocols
    _table(
        folder / "trials.csv",
        ["protocol", "trial", "top1", "top3", "error"],
        [
            [protocol, number, float(correct.mean()), float(in_top3.mean()), float(1 - correct.mean())]
            for protocol, runs in trials.items()
            for number, (correct, in_top3) in enumerate(zip(runs.correct, runs.in_top3, strict=True))
        ],
    )
    counts = {protocol: evaluation.confusion(protocol, len(classes)) for protocol in trials}
    _table(
        folder / "confusion.csv",
        ["protocol", "held", "predicted", "count"],
        [
            [protocol, classes[i], classes[j], int(table[i, j])]
            for protocol, table in counts.items()
            for i, j in np.ndindex(table.shape)
        ],
    )
    _table(
        folder / "per_class.csv",
        ["protocol", "object", "view_sets", "top1"],
        [
            [protocol, name, int(table[i].sum()), float(table[i, i] / table[i].sum())]
            for protocol, table in counts.items()
            for i, name in enumerate(classes)
            if table[i].sum()
        ],
    )


def flat_numbers(tree: dict[str, Any], prefix: str = "") -> dict[str, float]:
    """The tree's numbers under dotted keys."""
    flat: dict[str, float] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            flat |= flat_numbers(value, f"{prefix}{key}.")
        elif value is not None:
            flat[prefix + key] = value
    return flat


def intervals(metrics: dict) -> dict[str, str]:
    """The 95 % interval of each protocol's error, in words, by `error.PROTOCOL.ci95`."""
    return {
        f"error.{protocol}.ci95": _interval(metrics[protocol])
        for protocol in ("object", "recording")
        if protocol in metrics
    }


def summary_lines(metrics: dict, timing: dict) -> list[str]:
    """The summary: what was tested, the error under each protocol, and what it cost."""
    seconds, latency = timing["seconds"], timing["latency_ms"]
    ((side, groups),) = metrics["groups"].items()
    head = (
        f"evaluate: {metrics['frames'][side]:,} view sets of {metrics['views']}, {metrics['classes']} classes, "
        f"{metrics['trials']} trials, {groups} groups" + (" of the validation side" if side == "validation" else "")
    )
    return [
        head,
        *(_protocol_line(protocol, metrics[protocol]) for protocol in ("object", "recording") if protocol in metrics),
        *([_sequential(metrics["sequential"])] if "sequential" in metrics else []),
        "  time: "
        + ", ".join(f"{name} {value:,.1f} s" for name, value in seconds.items())
        + f"; the trials {timing['trials_seconds']:,.1f} s",
        f"  per view set: {latency['single']['median']:.2f} ms alone (95th percentile "
        f"{latency['single']['p95']:.2f}), {latency['batch']['median']:.2f} ms in batches; "
        f"peak memory {timing['peak_mb']:,.0f} MB",
        *(
            f"  {name} diverged in epoch {epoch:g}, and this is what the weights before it give"
            for name, epoch in metrics.get("diverged_in_epoch", {}).items()
        ),
    ]


def _protocol_line(protocol: str, score: dict) -> str:
    return (
        f"  {protocol} protocol: error {100 * score['error']['mean']:.1f} % (95 % interval over groups: "
        f"{_interval(score)}; std over trials {100 * score['top1']['std']:.1f}), "
        f"top-3 error {100 * (1 - score['top3']['mean']):.1f} %"
    )


def _interval(score: dict) -> str:
    ends = score["top1"]["ci95"]
    if not ends:
        return "none, there is one group"
    return f"{100 * (1 - ends['high']):.1f} to {100 * (1 - ends['low']):.1f}"


def _sequential(score: dict) -> str:
    fixed = ", ".join(f"{100 * one['error']:.1f} % with {count}" for count, one in score["fixed"].items())
    return (
        f"  sequential: error {100 * score['error']:.1f} % at a mean of {score['mean']:.2f} frames, stopping at "
        f"{score['confidence_threshold']:g}; {fixed}"
    )


def _json(path: Path, tree: dict) -> None:
    with atomic_write(path) as part:
        part.write_text(json.dumps(tree, indent=2) + "\n")


def _table(path: Path, header: list[str], rows: list[list]) -> None:
    with atomic_write(path) as part, part.open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])
