"""An evaluated pipeline as its files tell it: of the workspace, of a DVC experiment, or of an MLflow run."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import md5
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.evaluation.predictions import Predictions, read_predictions
from tactile_viewgcn.evaluation.report import divergences
from tactile_viewgcn.notes import Note
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.tables.frames import read_frames
from tactile_viewgcn.tables.views import read_views

STAGES = ("ingest", "preprocess", "cluster", "pretrain", "finetune", "evaluate")
REMEDY = "run `dvc repro`, or name a DVC experiment or an MLflow run"
MLFLOW_ID = re.compile(r"[0-9a-f]{32}")
Read = Callable[[str], bytes]  # the content of a file by its path in the workspace; FileNotFoundError


@dataclass(frozen=True)
class FinishedRun:
    """What an evaluated pipeline has left.

    Attributes:
        name: what it was asked for by; empty for the workspace.
        metrics, timing: results/metrics.json and timing.json.
        predictions: of every trial.
        records: by stage, see `stages.command`.
        cluster_means: (C, V, H, W) mean network input of each cluster of the training side; None where nothing was
            clustered, or the run keeps no frames that this version reads, as a run in MLflow.
    """

    name: str
    metrics: dict[str, Any]
    timing: dict[str, Any]
    predictions: Predictions
    records: dict[str, dict[str, Any]]
    cluster_means: np.ndarray | None

    @property
    def params(self) -> dict[str, Any]:
        """Every parameter, by dotted key."""
        return self.records["evaluate"]["params"]["values"]

    @property
    def simulated(self) -> bool:
        """Whether the recordings are those of the virtual glove."""
        return Path(self.params["data.source"]) == Path(VIRTUAL)

    @property
    def changed(self) -> dict[str, Any]:
        """Parameters that differ from the committed ones, by dotted key."""
        return self.records["evaluate"]["params"]["changed"]

    @property
    def notes(self) -> list[Note]:
        """What the stages noted, in their order, and which training diverged."""
        notes = [Note(**note) for record in self.records.values() for note in record["notes"]]
        return notes + divergences(self.metrics)


def read_run(name: str = "") -> FinishedRun:
    """The run of that name.

    Args:
        name: of a DVC experiment, or another revision that DVC knows; the id of an MLflow run of `evaluate`; empty for
            the workspace.

    Raises:
        UserError: no such run; files of it are missing, do not belong together, or are of an earlier version.
    """
    read = _of_mlflow(name) if MLFLOW_ID.fullmatch(name) else _of_experiment(name) if name else _of_workspace
    try:
        contents = {stage: read(f"runs/{stage}.json") for stage in STAGES}
        results = {file: read(f"results/{file}") for file in ("metrics.json", "timing.json", "predictions.npz")}
    except FileNotFoundError as error:
        raise UserError(f"{name or 'the workspace'}: no {error}; {REMEDY}") from None
    records = {stage: json.loads(content) for stage, content in contents.items()}
    _check(name, contents, records)
    return FinishedRun(
        name,
        json.loads(results["metrics.json"]),
        json.loads(results["timing.json"]),
        read_predictions(BytesIO(results["predictions.npz"])),
        records,
        _cluster_means(read),
    )


def _check(name: str, contents: dict[str, bytes], records: dict[str, dict[str, Any]]) -> None:
    """Raise a UserError for records of an earlier version, and for one that is not the one that was evaluated."""
    where, evaluated = name or "the workspace", records["evaluate"]["inputs"]
    for stage, record in records.items():
        if "origin" not in record or not all(isinstance(note, dict) for note in record["notes"]):
            raise UserError(f"{where}: runs/{stage}.json was written by an earlier version; run `dvc repro --force`")
        if stage in evaluated and evaluated[stage]["md5"] != md5(contents[stage], usedforsecurity=False).hexdigest():
            raise UserError(
                f"{where}: `{stage}` ran again after `evaluate`, so that the results are of an earlier run; {REMEDY}"
            )


def _cluster_means(read: Read) -> np.ndarray | None:
    """Mean frames (C, V, H, W); None where the frames are not kept, are of another version, or are not clustered."""
    try:
        table, views = read_frames(BytesIO(read("data/frames.h5"))), read_views(BytesIO(read("data/views.h5")))
    except (FileNotFoundError, UserError):
        return None
    return views.means(table) if views.clustered else None


def _of_workspace(path: str) -> bytes:
    if not Path(path).is_file():
        raise FileNotFoundError(path)
    return Path(path).read_bytes()


def _of_experiment(name: str) -> Read:
    """Reads the files of a revision that DVC knows; a UserError where there is none."""
    from dvc.api import DVCFileSystem

    files = DVCFileSystem(rev=name)
    if not files.exists("dvc.yaml"):
        raise UserError(
            f"{name}: no experiment of DVC here, and no id of an MLflow run, which has 32 digits; "
            "`dvc exp list` and `mlflow ui` name them"
        )
    return files.cat_file


def _of_mlflow(run_id: str) -> Read:
    """Reads the files that `evaluate` gave to its MLflow run, which keeps all but the frames."""
    from tactile_viewgcn.tracking import read_artifact

    return lambda path: read_artifact(run_id, Path(path).name)
