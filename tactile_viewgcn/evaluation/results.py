"""The results of `evaluate`: metrics, costs, tables, the row in MLflow and `dvc exp show`, and lines of text."""

import json
from pathlib import Path
from typing import Any

from tactile_viewgcn.evaluation.trials import (
    ASKED,
    PROTOCOLS,
    WHOLE,
    Predictions,
    write_predictions,
)
from tactile_viewgcn.files import new_files, readable
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.messages import NEW_SESSION, csv_text, several
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.provenance import EARLIER, Record
from tactile_viewgcn.schema import flatten

Records = dict[str, Record]  # of the earlier stages, by stage
# by name in metrics.json
SCORED = {WHOLE: ASKED[WHOLE], "new_session": NEW_SESSION} | dict(reversed(ASKED.items()))


def read_records(folder: Path) -> Records:
    """The records that a folder holds, by stage; a `UserError` names one that is damaged, or of another version."""
    records = {}
    for path in (folder / f"{stage}.json" for stage in EARLIER):
        if path.exists():
            with readable(path):
                records[path.stem] = Record.read(path.read_text())
    return records


def simulation(records: Records) -> Records:
    """The record of the virtual glove, where its recordings were read."""
    path = Path(f"{VIRTUAL}.json")
    simulated = "ingest" in records and records["ingest"].inputs["source"]["path"] == VIRTUAL
    return {"simulate": Record.read(path.read_text())} if simulated and path.exists() else {}


def costs(
    latency_ms: dict[str, dict[str, float]], records: Records, seconds: float, peak_mb: float
) -> dict[str, Any]:
    """Seconds of each stage and of all, latency in ms per answer, and the peak memory of the hungriest stage in MB.

    Args:
        seconds, peak_mb: of the stage `evaluate` itself.
    """
    each = {name: record.seconds for name, record in records.items()} | {"evaluate": seconds}
    peak = max([peak_mb, *(record.peak_mb for record in records.values())])
    return {
        "seconds": {
            name: round(value, 3) for name, value in (each | {"total": sum(each.values())}).items()
        },
        "latency_ms": latency_ms,
        "peak_mb": round(peak, 1),
    }


def new_session(records: Records) -> dict[str, Any]:
    """The score `new_session` of metrics.json, if `finetune` has measured it."""
    notes = [
        note
        for record in records.values()
        for note in record.notes
        if note.topic == "new session" and note.value
    ]
    return {"new_session": {"error": notes[0].value}} if notes else {}


def summary(metrics: dict[str, Any], timing: dict[str, Any]) -> dict[str, float]:
    """The numbers that runs are compared by: errors as fractions, seconds of all stages, ms per answer."""
    scores = {name: metrics[name] for name in SCORED if name in metrics}
    return {
        **{f"error.{name}": score["error"]["mean"] for name, score in scores.items()},
        **{
            f"top3_error.{name}": score["top3_error"]
            for name, score in scores.items()
            if "top3_error" in score
        },
        "seconds.total": timing["seconds"]["total"],
        "ms_per_answer": timing["latency_ms"]["single"]["median"],
        "ms_per_recording": timing["latency_ms"][WHOLE]["median"],
    }


def errors_by_frames(metrics: dict[str, Any]) -> dict[str, list[tuple[int, dict[str, Any]]]]:
    """By protocol, the numbers of frames and the errors; those of `recording` end with whole recordings."""
    errors = {name: list(metrics[name]["by_views"].items()) for name in PROTOCOLS}
    errors["recording"] += metrics[WHOLE]["by_views"].items()
    return {name: [(int(count), error) for count, error in each] for name, each in errors.items()}


def write_results(
    folder: Path, predictions: Predictions, metrics: dict[str, Any], timing: dict[str, Any]
) -> None:
    """Write predictions, metrics.json, tables of trials, views, confusion and classes, and the costs in timing.json.

    All but the costs are equal on every run with one seed. DVC shows summary.json, which has some
    of both.
    """
    classes = predictions.classes.tolist()
    trees = {"metrics": metrics, "timing": timing, "summary": summary(metrics, timing)}
    tables: dict[str, list[list]] = {
        "trials": [["protocol", "trial", "error"]],
        "views": [["protocol", "views", "error", "low", "high"]],
        "confusion": [["protocol", "object", "predicted", "count"]],
        "per_class": [["protocol", "object", "answers", "error"]],
    }
    for protocol, errors in errors_by_frames(metrics).items():
        tables["views"] += [
            [protocol, count, *(error[key] for key in ("mean", "low", "high"))]
            for count, error in errors
        ]
    for asked, trials in predictions.trials.items():
        tables["trials"] += [[asked, *row] for row in enumerate(trials.errors.tolist())]
        for label, counts in enumerate(trials.confusion(len(classes)).tolist()):
            name, answers = classes[label], sum(counts)
            tables["confusion"] += [
                [asked, name, *pair] for pair in zip(classes, counts, strict=True)
            ]
            if answers:
                tables["per_class"].append([asked, name, answers, 1 - counts[label] / answers])
    with new_files(folder) as part:
        write_predictions(part / "predictions.npz", predictions)
        for name, tree in trees.items():
            (part / f"{name}.json").write_text(json.dumps(tree, indent=2) + "\n")
        for name, rows in tables.items():
            (part / f"{name}.csv").write_text(csv_text(rows), "utf-8", newline="")


def row_tags_parameters_metrics(
    metrics: dict[str, Any], timing: dict[str, Any], records: Records
) -> tuple[dict[str, str], dict[str, float], dict[str, float]]:
    """What the row has besides params.yaml.

    Tags: the ids of the stages' runs, and what `auto` chose. Parameters: numbers of classes, of
    frames, recordings and groups on a side, and of weights. Metrics: the summary, the seconds of
    each stage and the peak memory.
    """
    counts = {name: value for record in records.values() for name, value in record.counts.items()}
    tags = {f"stage.{name}": record.run_id for name, record in records.items() if record.run_id}
    tags |= {name: str(value) for name, value in counts.items() if name.startswith("resolved.")}
    weights = {name: value for name, value in counts.items() if name.startswith("weights.")}
    parameters = (
        flatten({name: metrics[name] for name in ("classes", "frames", "recordings", "groups")})
        | weights
    )
    return (
        tags,
        parameters,
        summary(metrics, timing) | flatten({name: timing[name] for name in ("seconds", "peak_mb")}),
    )


def summary_lines(metrics: dict, timing: dict) -> list[str]:
    """The number of tests, the error in per cent of each of `SCORED` with its interval, and the costs."""
    latency, ((side, groups),) = timing["latency_ms"], metrics["groups"].items()
    lines = [
        f"evaluate on the {side} side: {several(metrics['frames'][side], 'view set')} of {metrics['views']}, "
        f"{several(metrics['recordings'][side], 'recording')}, {several(metrics['classes'], 'class', 'classes')}, "
        f"{several(metrics['trials'], 'trial')}, {several(groups, 'group')}"
    ]
    for name in filter(metrics.__contains__, reversed(SCORED)):
        score = metrics[name]
        error = score["error"]
        top3 = f", top-3 error {100 * score['top3_error']:.1f} %" if "top3_error" in score else ""
        std = f", std over trials {100 * error['std']:.1f}" if name in PROTOCOLS else ""
        interval = percent_interval(error["mean"], error["low"], error["high"])
        lines.append(f"  {SCORED[name]}: error {interval} %{std}{top3}")
    times = ", ".join(f"{name} {value:,.1f} s" for name, value in timing["seconds"].items())
    return [
        *lines,
        f"  time: {times}",
        f"  per answer: {latency['single']['median']:.2f} ms alone (95th percentile "
        f"{latency['single']['p95']:.2f}), {latency['batch']['median']:.2f} ms in batches, "
        f"{latency[WHOLE]['median']:.2f} ms a whole recording; peak memory {timing['peak_mb']:,.0f} MB",
    ]
