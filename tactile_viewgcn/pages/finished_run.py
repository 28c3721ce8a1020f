"""An evaluated pipeline, read from its files: of the workspace, of a DVC experiment, or of an MLflow run."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import md5
from io import BytesIO
from pathlib import Path
from typing import Any

from tactile_viewgcn.evaluation.trials import Predictions, read_predictions
from tactile_viewgcn.files import readable
from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.provenance import EARLIER, ROW, Record

REMEDY = "run `dvc repro`, or name a DVC experiment or an MLflow run"
MLFLOW_ID = re.compile(r"[0-9a-f]{32}")


@dataclass(frozen=True)
class FinishedRun:
    """The files of an evaluated pipeline.

    Attributes:
        name: as the user named it; empty for the workspace.
        metrics, timing: results/metrics.json and timing.json.
        predictions: of every trial.
        records: by stage.
    """

    name: str
    metrics: dict[str, Any]
    timing: dict[str, Any]
    predictions: Predictions
    records: dict[str, Record]

    @property
    def params(self) -> dict[str, Any]:
        """Every parameter, by dotted key."""
        return self.records["evaluate"].params["values"]

    @property
    def simulated(self) -> bool:
        """Whether the recordings are those of the virtual glove."""
        return Path(self.params["data.source"]) == Path(VIRTUAL)

    @property
    def changed(self) -> dict[str, Any]:
        """Parameters that differ from the committed ones, by dotted key."""
        return self.records["evaluate"].params["changed"]

    def notes(self, level: str) -> list[Note]:
        """The stages' notes of that level, in the order of the stages."""
        return [note for record in self.records.values() for note in record.notes if note.level == level]


def read_run(name: str = "") -> FinishedRun:
    """The run of that name.

    Args:
        name: of a DVC experiment, or another revision that DVC knows; the id of an MLflow run of `evaluate`; empty for
            the workspace.

    Raises:
        UserError: no such run; its files are missing, damaged, do not belong together, or are of an earlier version.
    """
    where, read_file = name or "the workspace", _reader(name)

    def read(path: str) -> bytes:
        try:
            return read_file(path)
        except FileNotFoundError:
            raise UserError(f"{where}: no {path}; {REMEDY}") from None

    contents = {stage: read(f"runs/{stage}.json") for stage in EARLIER}
    contents[ROW], metrics, timing = (read(f"results/{file}.json") for file in (ROW, "metrics", "timing"))
    predictions = read("results/predictions.npz")
    with readable(f"{where}: a file of runs/ or results/"):
        records = {stage: Record.read(content) for stage, content in contents.items()}
        run = FinishedRun(
            name, json.loads(metrics), json.loads(timing), read_predictions(BytesIO(predictions)), records
        )
        evaluated = records["evaluate"].inputs
    for stage, content in contents.items():
        if stage in evaluated and evaluated[stage]["md5"] != md5(content, usedforsecurity=False).hexdigest():
            raise UserError(
                f"{where}: `{stage}` ran again after `evaluate`, so that the results are of an earlier run; {REMEDY}"
            )
    return run


def _reader(name: str) -> Callable[[str], bytes]:
    """A function that reads a file of that run by its path in the workspace, or raises FileNotFoundError."""
    if not name:
        return lambda path: Path(path).read_bytes()
    if MLFLOW_ID.fullmatch(name):
        from tactile_viewgcn.tracking import read_artifact

        return lambda path: read_artifact(name, Path(path).name)
    from dvc.api import DVCFileSystem

    files = DVCFileSystem(rev=name)
    if not files.exists("dvc.yaml"):
        raise UserError(
            f"{name}: no experiment of DVC here, and no id of an MLflow run, which has 32 digits; "
            "`dvc exp list` and `mlflow ui` name them"
        )
    return files.cat_file
