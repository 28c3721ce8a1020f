"""The row of an evaluated pipeline, in MLflow and `dvc exp show`: error and time as numbers, constants beside them."""

from typing import Any

from tactile_viewgcn.evaluation.evaluate import Evaluation
from tactile_viewgcn.evaluation.report import flat_numbers, intervals

DIGEST = 8  # of an md5's digits, as many as MLflow has in a digest
Records = dict[str, dict[str, Any]]  # of the earlier stages, see `report.read_records`


def summary(metrics: dict[str, Any], timing: dict[str, Any]) -> dict[str, Any]:
    """The few numbers that runs are compared by: errors as fractions, seconds of all stages, ms per view set."""
    scores = {protocol: metrics[protocol] for protocol in ("recording", "object") if protocol in metrics}
    sequential = {"sequential": metrics["sequential"]["error"]} if "sequential" in metrics else {}
    return {
        "error": {protocol: score["error"]["mean"] for protocol, score in scores.items()} | sequential,
        "top3_error": {protocol: 1 - score["top3"]["mean"] for protocol, score in scores.items()},
        "seconds": {"total": timing["seconds"]["total"]},
        "ms_per_view_set": timing["latency_ms"]["single"]["median"],
    }


def row_metrics(metrics: dict[str, Any], timing: dict[str, Any]) -> dict[str, float]:
    """The summary, the seconds of each stage and the peak memory, by dotted key."""
    more = {"seconds": timing["seconds"], "peak_mb": timing["peak_mb"]}
    return flat_numbers(summary(metrics, timing)) | flat_numbers(more)


def row_tags(metrics: dict[str, Any], records: Records) -> dict[str, str]:
    """The intervals in words, the runs of the other stages, and in which epoch one of them diverged."""
    runs = {f"stage.{name}": record["run_id"] for name, record in records.items() if record["run_id"]}
    diverged = {
        f"diverged.{name}": f"in epoch {epoch:g}" for name, epoch in metrics.get("diverged_in_epoch", {}).items()
    }
    return intervals(metrics) | runs | diverged


def counts(metrics: dict[str, Any], records: Records) -> dict[str, float]:
    """Numbers of classes, of frames and groups on each side, and of weights: constants, not results."""
    sizes = flat_numbers({name: metrics[name] for name in ("classes", "frames", "groups")})
    weights = {name: value for record in records.values() for name, value in record["counts"].items()}
    return sizes | {name: value for name, value in weights.items() if name.startswith("weights.")}


def dataset(records: Records, frames: str, md5: str) -> tuple[str, str]:
    """Path and digest of the recordings; of the table of frames where no record of ingest is given."""
    source = records["ingest"]["inputs"]["source"] if "ingest" in records else {"path": frames, "md5": md5}
    return source["path"], source["md5"][:DIGEST]


def divergences(records: Records) -> dict[str, dict[str, float]]:
    """`diverged_in_epoch` by stage, where a training diverged; what is evaluated are the weights before it."""
    name = "diverged_in_epoch"
    epochs = {stage: record["counts"][name] for stage, record in records.items() if name in record["counts"]}
    return {name: epochs} if epochs else {}


def trial_errors(evaluation: Evaluation) -> dict[str, list[float]]:
    """The error of each trial, by `trials.error.PROTOCOL`."""
    return {
        f"trials.error.{protocol}": (1 - trials.correct.mean(axis=1)).tolist()
        for protocol, trials in evaluation.protocols.items()
    }
