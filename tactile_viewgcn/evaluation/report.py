"""What evaluate leaves behind: metrics, timings, tables, and a summary in five lines."""

import csv
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.evaluation import Evaluation
from tactile_viewgcn.files import whole
from tactile_viewgcn.frames import Frames
from tactile_viewgcn.split import TEST, TRAIN


def metrics_tree(evaluation: Evaluation, table: Frames, views: int) -> dict[str, Any]:
    """Everything of an evaluation that is the same on every run with one seed; accuracies are fractions."""
    groups = evaluation.groups
    frames = {
        name: int((table.anchor & (table.side == code)).sum()) for name, code in (("train", TRAIN), ("test", TEST))
    }
    frames |= {f"kept_{name}": len(table.on(code)) for name, code in (("train", TRAIN), ("test", TEST))}
    return {
        "views": views,
        "classes": len(table.classes),
        "trials": evaluation.trials,
        "frames": frames,
        "groups": {"test": len(np.unique(groups))},
    } | evaluation.scores


def read_records(paths: Iterable[Path]) -> dict[str, dict]:
    """The records of earlier stages, by stage."""
    records = [json.loads(path.read_text()) for path in paths]
    return {record["stage"]: record for record in records}


def costs(evaluation: Evaluation, records: dict[str, dict], peak_mb: float) -> dict[str, Any]:
    """Seconds of each stage, latency in ms per view set, and the peak memory of the hungriest stage in MB."""
    seconds = {name: round(record["seconds"], 3) for name, record in records.items()}
    peak = max([peak_mb, *(record["peak_mb"] for record in records.values())])
    return {
        "seconds": seconds | {"evaluate": round(evaluation.seconds, 3)},
        "latency_ms": evaluation.latency_ms,
        "peak_mb": round(peak, 1),
    }


def write_results(folder: Path, metrics: dict, timing: dict, evaluation: Evaluation, classes: list[str]) -> None:
    """metrics.json, timing.json, trials.csv, confusion.csv and per_class.csv."""
    _json(folder / "metrics.json", metrics)
    _json(folder / "timing.json", timing)
    trials = evaluation.protocols
    _table(
        folder / "trials.csv",
        ["protocol", "trial", "top1", "top3", "error"],
        [
            [scope, number, float(right.mean()), float(near.mean()), float(1 - right.mean())]
            for scope, runs in trials.items()
            for number, (right, near) in enumerate(zip(runs.right, runs.near, strict=True))
        ],
    )
    counts = {scope: evaluation.confusion(scope, len(classes)) for scope in trials}
    _table(
        folder / "confusion.csv",
        ["protocol", "held", "predicted", "count"],
        [
            [scope, classes[i], classes[j], int(table[i, j])]
            for scope, table in counts.items()
            for i, j in np.ndindex(table.shape)
        ],
    )
    _table(
        folder / "per_class.csv",
        ["protocol", "object", "view_sets", "top1"],
        [
            [scope, name, int(table[i].sum()), float(table[i, i] / table[i].sum())]
            for scope, table in counts.items()
            for i, name in enumerate(classes)
            if table[i].sum()
        ],
    )


def numbers(tree: dict[str, Any], prefix: str = "") -> dict[str, float]:
    """The tree's numbers under dotted keys; the two ends of an interval as `.low` and `.high`."""
    found: dict[str, float] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            found |= numbers(value, f"{prefix}{key}.")
        elif isinstance(value, list):
            found |= {f"{prefix}{key}.low": value[0], f"{prefix}{key}.high": value[1]}
        elif value is not None:
            found[prefix + key] = value
    return found


def lines(metrics: dict, timing: dict) -> list[str]:
    """The summary: what was tested, the error under each protocol, and what it cost."""
    seconds, latency = timing["seconds"], timing["latency_ms"]
    head = (
        f"evaluate: {metrics['frames']['test']:,} view sets of {metrics['views']}, {metrics['classes']} classes, "
        f"{metrics['trials']} trials, {metrics['groups']['test']} groups"
    )
    return [
        head,
        *(_line(scope, metrics[scope]) for scope in ("object", "recording") if scope in metrics),
        *([_touches(metrics["touches"])] if "touches" in metrics else []),
        "  time: " + ", ".join(f"{name} {value:,.1f} s" for name, value in seconds.items()),
        f"  per view set: {latency['single']['median']:.2f} ms alone (95th percentile "
        f"{latency['single']['p95']:.2f}), {latency['batch']['median']:.2f} ms in batches; "
        f"peak memory {timing['peak_mb']:,.0f} MB",
    ]


def _line(scope: str, score: dict) -> str:
    interval = score["top1"]["ci95"]
    between = (
        f"{100 * (1 - interval[1]):.1f} to {100 * (1 - interval[0]):.1f}"
        if interval
        else "none, the test side is one group"
    )
    return (
        f"  {scope} protocol: error {100 * score['error']['mean']:.1f} % (95 % interval over groups: {between}; "
        f"clustering spread {100 * score['top1']['spread']:.1f}), top-3 error {100 * (1 - score['top3']['mean']):.1f} %"
    )


def _touches(score: dict) -> str:
    fixed = ", ".join(f"{100 * one['error']:.1f} % with {count}" for count, one in score["fixed"].items())
    return (
        f"  touches: error {100 * score['error']:.1f} % at a mean of {score['mean']:.2f} touches, stopping at "
        f"{score['stop_at']:g}; {fixed}"
    )


def _json(path: Path, tree: dict) -> None:
    with whole(path) as part:
        part.write_text(json.dumps(tree, indent=2) + "\n")


def _table(path: Path, header: list[str], rows: list[list]) -> None:
    with whole(path) as part, part.open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])
