"""Where a run comes from: code, machine, versions, and what it changes of the committed params.yaml, which names it."""

import os
import platform
import socket
import subprocess
import sys
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from tactile_viewgcn.process import processor, usable_cores
from tactile_viewgcn.schema import as_change, flatten, parse

MOST_FILES = 20  # changed files that are named
WRITTEN = "dvc.lock", "results/summary.json"  # by every run, which is no change of the code
PACKAGES = ("torch", "scikit-learn", "numpy", "dvc", "mlflow")  # whose versions a run keeps


def git_revision() -> dict[str, str]:
    """The commit of the code that runs, whether files of it were changed, and which, a line each; empty outside git."""
    commit = _git("rev-parse", "HEAD")
    excluded = [f":(top,exclude,glob)**/{name}" for name in WRITTEN]
    names = _git("diff", "HEAD", "--name-only", "--no-renames", "-z", "--", ":/", *excluded)
    if not commit:
        return {}
    changed = names.split("\0")[:-1]
    if len(changed) > MOST_FILES:
        changed[MOST_FILES:] = [f"and {len(changed) - MOST_FILES} more"]
    revision = {"mlflow.source.git.commit": commit.strip(), "git.dirty": str(bool(changed)).lower()}
    return revision | ({"git.changed": "\n".join(changed)} if changed else {})


def run_tags(stage: str) -> dict[str, str]:
    """Tags of a stage's run in MLflow: command, code and DVC experiment."""
    tags = {"stage": stage, "command": " ".join(sys.orig_argv[1:]), "mlflow.source.name": f"stages/{stage}.py"}
    experiment = {"dvc.experiment": os.environ["DVC_EXP_NAME"]} if "DVC_EXP_NAME" in os.environ else {}
    return tags | experiment | git_revision()


def committed_params(path: Path) -> dict[str, Any]:
    """The values of a params.yaml as it is in git's HEAD, by dotted key; empty where it is not there."""
    try:
        tree = parse(_git("show", f"HEAD:./{path.name}", folder=path.parent))
    except ValueError:
        return {}
    return flatten(tree) if isinstance(tree, dict) else {}


def changes_of(values: dict[str, Any], committed: dict[str, Any]) -> dict[str, Any]:
    """The values, by dotted key, that differ from the committed ones; a key that is not committed is left out."""
    return {key: value for key, value in values.items() if key in committed and value != committed[key]}


def run_name(values: dict[str, Any], committed: dict[str, Any], texts: dict[str, str]) -> str:
    """A name for people: the values that differ from the committed ones, then others: `V=12 pretrain.lr=0.01 mvcnn`.

    Args:
        values: by dotted key; a key that is not committed is left out.
        texts: what stands in every name, in its own words; by key, where it is a value's.
    """
    changed = changes_of(values, committed)
    first = [texts.get(key) or as_change(key, value) for key, value in changed.items()]
    return " ".join([*first, *(text for key, text in texts.items() if key not in changed)])


def origin() -> dict[str, str]:
    """When, where and by what code this process computes: time, host, processor, git revision, versions."""
    versions = {}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return {
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "host": socket.gethostname(),
        "processor": processor(),
        "cores": str(usable_cores()),
        **git_revision(),
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
