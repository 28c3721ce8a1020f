"""The record of a stage: what it did, with which code and parameters, on which machine, at what cost."""

import json
import os
import platform
import re
import resource
import socket
import subprocess
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tactile_viewgcn.messages import Note
from tactile_viewgcn.schema import as_change, flatten, parse

ROW = "evaluate"  # the stage whose run is the pipeline's row in MLflow
# the stages whose records it reads
EARLIER = "ingest", "preprocess", "cluster", "pretrain", "finetune"
# no change of the code: a record has its parameters
WRITTEN = "params.yaml", "dvc.lock", "results/summary.json"
PACKAGES = "torch", "scikit-learn", "numpy"  # a record has their versions


@dataclass
class Record:
    """The content of a stage's record: runs/STAGE.json, and results/evaluate.json.

    Attributes:
        name, run_id: of the stage's run in MLflow; None where it has none.
        seconds: of the process, and of the training before an interruption; peak_mb: see `peak_mb`.
        inputs: `path` of each input, by its name, and its `md5` where the stage needs it.
        counts: single values; curves: a value for each epoch; both by name.
        params: `values`, the parameters that the stage reads, and `changed`, those that differ from
            git; by dotted key.
        origin: see `origin`; and `device` and `precision` of a stage that computes with torch.
    """

    stage: str
    name: str | None = None
    run_id: str | None = None
    seconds: float = 0.0
    peak_mb: float = 0.0
    inputs: dict[str, dict[str, str]] = field(default_factory=dict)
    counts: dict[str, Any] = field(default_factory=dict)
    curves: dict[str, list[float]] = field(default_factory=dict)
    params: dict[str, dict[str, Any]] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)
    origin: dict[str, str] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """The record as JSON."""
        return json.dumps(asdict(self), indent=2) + "\n"

    @classmethod
    def read(cls, text: str | bytes) -> "Record":
        """The record that a file holds as `text`; any exception where it is damaged."""
        content = json.loads(text)
        return cls(**content | {"notes": [Note(**note) for note in content["notes"]]})


def git_revision() -> dict[str, str]:
    """The commit of the code, and whether a file differs from it that is not in `WRITTEN`; empty outside git."""
    excluded = [f":(top,exclude,glob)**/{name}" for name in WRITTEN]
    changed = _git("diff", "HEAD", "--name-only", "--", ":/", *excluded)
    commit = _git("rev-parse", "HEAD").strip()
    return (
        {"mlflow.source.git.commit": commit, "git.dirty": str(bool(changed)).lower()}
        if commit
        else {}
    )


def changed_params(values: dict[str, Any], path: Path) -> dict[str, Any]:
    """The values, by dotted key, that differ from those of the same params.yaml in git's HEAD; none outside git."""
    committed = committed_params(path)
    return {
        key: value for key, value in values.items() if key in committed and value != committed[key]
    }


def committed_params(path: Path) -> dict[str, Any]:
    """The values of that params.yaml in git's HEAD, by dotted key; none outside git."""
    tree = parse(_git("show", f"HEAD:./{path.name}", folder=path.parent), path)
    return flatten(tree) if isinstance(tree, dict) else {}


def run_name(changed: dict[str, Any], *words: str) -> str:
    """Name of a run for people, such as `views=12 pretrain.lr=0.01 mvcnn`: changed parameters, then words.

    The shortest stands first: a list cuts long names, and runs with one long path differ in a short
    value.
    """
    return " ".join([*sorted(map(as_change, changed, changed.values()), key=len), *words])


def origin(stage: str) -> dict[str, str]:
    """Stage, DVC experiment, git revision, time, machine, and versions of Python and of `PACKAGES`."""
    # respects a container's limit; here, since a logged model does without joblib
    from joblib import cpu_count

    experiment = os.environ.get("DVC_EXP_NAME")
    return {
        "stage": stage,
        **({"dvc.experiment": experiment} if experiment else {}),
        **git_revision(),
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "host": socket.gethostname(),
        "processor": processor(),
        "cores": str(cpu_count()),
        "python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
    }


def processor() -> str:
    """The processor's name."""
    info = Path("/proc/cpuinfo")
    names = re.findall(r"model name\s*: (.*)", info.read_text()) if info.exists() else []
    return names[0] if names else platform.processor() or platform.machine()


def peak_mb() -> float:
    """Peak memory, in MB (10^6 bytes), of this process or of a child process that has ended, whichever is larger."""
    peak, children = (
        resource.getrusage(who).ru_maxrss
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    with suppress(OSError):  # on Linux ru_maxrss of this process also counts its parent's memory
        peak = int(re.findall(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())[0])
    return max(peak, children) * (1 if sys.platform == "darwin" else 1024) / 1e6


def _git(*words: str, folder: Path = Path()) -> str:
    """Output of git; empty where there is no git, no repository, or git refuses."""
    try:
        output = subprocess.run(["git", *words], cwd=folder, capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return ""
    return output.decode(errors="replace")
