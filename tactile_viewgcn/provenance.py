"""The record of a stage, runs/STAGE.json: what it did, with which code and parameters, on which machine, at what cost.

A run in MLflow is named by the parameters that differ from the params.yaml in git.
"""

import json
import os
import platform
import socket
import subprocess
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from tactile_viewgcn.messages import Note
from tactile_viewgcn.process import processor
from tactile_viewgcn.schema import as_change, flatten, parse

WRITTEN = "params.yaml", "dvc.lock", "results/summary.json"  # no change of the code: a record has its parameters
PACKAGES = ("torch", "scikit-learn", "numpy", "dvc", "mlflow")  # a record has their versions


@dataclass(frozen=True)
class Record:
    """The content of runs/STAGE.json.

    Attributes:
        stage: the stage's name.
        run_id: of the stage's run in MLflow; None where it has none.
        seconds: of the process, and of the training before an interruption; peak_mb: see `process.peak_mb`.
        inputs: `path` of each input, by its name, and its `md5` where the stage needs it.
        counts: single values; curves: a value for each epoch; both by name.
        params: `values`, the parameters that the stage reads, and `changed`, those that differ from git; by dotted key.
        notes: the stage's remarks.
        origin: see `origin`; and `device` and `precision` of a stage that computes with torch.
    """

    stage: str
    run_id: str | None
    seconds: float
    peak_mb: float
    inputs: dict[str, dict[str, str]]
    counts: dict[str, Any]
    curves: dict[str, list[float]]
    params: dict[str, dict[str, Any]]
    notes: list[Note]
    origin: dict[str, str]

    @property
    def tags(self) -> dict[str, str]:
        """Tags of the run in MLflow: origin, and md5 of inputs."""
        return self.origin | {f"md5.{name}": each["md5"] for name, each in self.inputs.items() if "md5" in each}

    @property
    def text(self) -> str:
        """The record as JSON."""
        return json.dumps(asdict(self), indent=2) + "\n"

    @classmethod
    def read(cls, text: str | bytes) -> "Record":
        """The record that a file holds as `text`; any exception where it is damaged, or a field is missing."""
        content = json.loads(text)
        values = {field.name: content[field.name] for field in fields(cls)}
        return cls(**values | {"notes": [Note(**note) for note in content["notes"]]})


def git_revision() -> dict[str, str]:
    """The commit of the code, and whether a file differs from it that is not in `WRITTEN`; empty outside git."""
    excluded = [f":(top,exclude,glob)**/{name}" for name in WRITTEN]
    changed = _git("diff", "HEAD", "--name-only", "--", ":/", *excluded)
    commit = _git("rev-parse", "HEAD").strip()
    return {"mlflow.source.git.commit": commit, "git.dirty": str(bool(changed)).lower()} if commit else {}


def changed_params(values: dict[str, Any], path: Path) -> dict[str, Any]:
    """The values, by dotted key, that differ from those of the same params.yaml in git's HEAD; none outside git."""
    tree = parse(_git("show", f"HEAD:./{path.name}", folder=path.parent), path)
    committed = flatten(tree) if isinstance(tree, dict) else {}
    return {key: value for key, value in values.items() if key in committed and value != committed[key]}


def run_name(changed: dict[str, Any], *words: str) -> str:
    """A name for people, such as `views=12 pretrain.lr=0.01 mvcnn`: changed values, then words.

    The shortest stands first: a list cuts long names, and runs with one long path differ in a short value.
    """
    return " ".join([*sorted(map(as_change, changed, changed.values()), key=len), *words])


def origin(stage: str) -> dict[str, str]:
    """Stage, command, DVC experiment, git revision, time, machine, and versions of Python and of `PACKAGES`."""
    from joblib import cpu_count  # respects a container's limit; here, since a logged model does without joblib

    versions = {}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return {
        "stage": stage,
        "command": " ".join(sys.orig_argv[1:]),
        "mlflow.source.name": f"stages/{stage}.py",
        **({"dvc.experiment": os.environ["DVC_EXP_NAME"]} if "DVC_EXP_NAME" in os.environ else {}),
        **git_revision(),
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "host": socket.gethostname(),
        "processor": processor(),
        "cores": str(cpu_count()),
        "python": platform.python_version(),
        **versions,
    }


def _git(*words: str, folder: Path = Path()) -> str:
    """Output of git; empty where there is no git, no repository, or git refuses."""
    try:
        output = subprocess.run(["git", *words], cwd=folder, capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return ""
    return output.decode(errors="replace")
