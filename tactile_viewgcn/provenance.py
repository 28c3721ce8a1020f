"""The record of a stage: what it did, by which code and parameters, where, and at what cost."""

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
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from tactile_viewgcn.messages import Note
from tactile_viewgcn.params import VIRTUAL, presets, read_preset
from tactile_viewgcn.schema import as_change, flatten, parse

ROW = "evaluate"  # the stage whose run is the pipeline's row in MLflow
# the stages whose records `evaluate` reads
EARLIER = ("ingest", "preprocess", "cluster", "pretrain", "finetune")
# files whose changes are no change of the code, since a record has all parameters
WRITTEN = ("params.yaml", "dvc.lock", "results/summary.json")
SEPARATOR = " · "  # between the parts of a run's name
ANY_NAME = ("metadata", "recordings", "data")  # names of files that say nothing about the data
# packages whose versions a record has
PACKAGES = ("torch", "scikit-learn", "numpy", "scipy", "dvc", "mlflow")


@dataclass
class Record:
    """The content of a stage's record: runs/STAGE.json, and results/evaluate.json.

    Attributes:
        stage: name of the stage.
        name: name of the stage's run in MLflow; None if it has no run.
        run_id: id of the stage's run in MLflow; None if it has no run.
        seconds: duration of the process, and of the training run before an interruption.
        peak_mb: see the function `peak_mb`.
        inputs: by name of the input, its `path`, and its `md5` if the stage needs it.
        counts: single values, by name.
        curves: a value for each epoch, by name.
        params: by dotted key, `values`, the parameters that the stage reads, and `changed`, the
            parameters that differ from git.
        notes: what the stage tells the user.
        origin: see the function `origin`. A stage that computes with torch adds `device` and
            `precision`.
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
        """Return the record as JSON."""
        return json.dumps(asdict(self), indent=2) + "\n"

    @classmethod
    def read(cls, text: str | bytes) -> "Record":
        """Return the record that a file holds as `text`.

        Raises:
            Exception: the text is damaged; any exception is possible.
        """
        content = json.loads(text)
        notes = [Note(**note) for note in content["notes"]]
        return cls(**content | {"notes": notes})


def git_revision() -> dict[str, str]:
    """Return the commit of the code, and whether a file differs from the commit.

    Files that a run writes, see `WRITTEN`, do not count. Outside git the result is empty.
    """
    commit = _git("rev-parse", "HEAD").strip()
    if not commit:
        return {}
    excluded = [f":(top,exclude,glob)**/{name}" for name in WRITTEN]
    changed = _git("diff", "HEAD", "--name-only", "--", ":/", *excluded)
    return {"mlflow.source.git.commit": commit, "git.dirty": str(bool(changed)).lower()}


def changed_params(values: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return the values that differ from params.yaml in git's HEAD; outside git there are none.

    Args:
        values: parameters by dotted key.
        path: of params.yaml.
    """
    committed = committed_params(path)
    return {
        key: value for key, value in values.items() if key in committed and value != committed[key]
    }


def committed_params(path: Path) -> dict[str, Any]:
    """Return the values of params.yaml in git's HEAD, by dotted key; outside git there are none."""
    tree = parse(_git("show", f"HEAD:./{path.name}", folder=path.parent), path)
    if not isinstance(tree, dict):
        return {}
    return flatten(tree)


def run_name(stage: str, values: dict[str, Any], changed: dict[str, Any]) -> str:
    """Return the name of a run for people, such as `flex_glove · best · by session · views=12`.

    The data, the system or preset, and the split come first. All other changes follow, the shortest
    first. The name of a stage's run begins with the stage.

    Args:
        stage: name of the stage; the stage `ROW` stands for the whole pipeline.
        values: the parameters that the stage reads, by dotted key.
        changed: the parameters among them that differ from the committed ones.
    """
    parts = []
    if stage != ROW:
        parts.append(stage)
    named = set[str]()
    if "data.source" in values:
        parts.append(data_name(values["data.source"]))
        named |= {"data.source"}
    if "model.system" in values:
        method, keys = _method(values)
        parts.append(method)
        named |= keys
    if "split.by" in values:
        parts.append(_held_out(values))
        named |= {"split.by", "split.folds", "split.fold"}
    others = [as_change(key, value) for key, value in changed.items() if key not in named]
    if others:
        parts.append(" ".join(sorted(others, key=len)))
    return SEPARATOR.join(parts)


def data_name(source: str) -> str:
    """Return the name of a data source in the names of runs and folders."""
    if source == VIRTUAL:
        return "simulated"
    path = Path(source)
    if path.stem in ANY_NAME:
        return path.parent.name or path.name
    return path.stem if path.suffix else path.name


def _method(values: dict[str, Any]) -> tuple[str, set[str]]:
    """Return the preset that agrees with all values, or else the system; and the keys it sets.

    If several presets agree, the preset with the most keys is returned.
    """
    fitting = []
    for name in presets():
        settings = read_preset(name)
        if all(values.get(key) == value for key, value in settings.items()):
            fitting.append((len(settings), name, set(settings)))
    if not fitting:
        return values["model.system"], {"model.system"}
    _, name, keys = max(fitting)
    return name, keys | {"model.system"}


def _held_out(values: dict[str, Any]) -> str:
    """Return how the test set is held out, in words."""
    if values["split.by"] == "source":
        return "published split"
    text = f"by {values['split.by']}"
    if values["split.fold"]:
        text += f", fold {values['split.fold']} of {values['split.folds']}"
    return text


def origin(stage: str) -> dict[str, str]:
    """Return the stage, DVC's experiment, the commit, the time, the machine and the versions.

    Args:
        stage: name of the stage.
    """
    # joblib respects a container's limit; imported here, since a logged model does without it
    from joblib import cpu_count

    tags = {"stage": stage}
    experiment = os.environ.get("DVC_EXP_NAME")
    if experiment:
        tags["dvc.experiment"] = experiment
    tags |= git_revision()
    tags["time"] = datetime.now(UTC).isoformat(timespec="seconds")
    tags["host"] = socket.gethostname()
    tags["processor"] = processor()
    tags["cores"] = str(cpu_count())
    tags["python"] = platform.python_version()
    for name in PACKAGES:
        with suppress(PackageNotFoundError):  # DVC can be installed outside this environment
            tags[name] = version(name)
    return tags


def processor() -> str:
    """Return the name of the CPU."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = re.findall(r"model name\s*: (.*)", info.read_text())
        if names:
            name: str = names[0]
            return name
    return platform.processor() or platform.machine()


def peak_mb() -> float:
    """Return the peak memory in 10^6 bytes, of this process or of a child that has ended.

    The larger of the two is returned.
    """
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    with suppress(OSError):  # on Linux ru_maxrss of this process also counts its parent's memory
        peak = int(re.findall(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())[0])
    unit = 1 if sys.platform == "darwin" else 1024  # bytes
    return max(peak, children) * unit / 1e6


def _git(*words: str, folder: Path = Path()) -> str:
    """Return the output of git; empty if there is no git or no repository, or git refuses."""
    try:
        output = subprocess.run(["git", *words], cwd=folder, capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return ""
    return output.decode(errors="replace")
