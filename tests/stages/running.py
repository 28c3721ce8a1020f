"""Stages that run from their command line in this process, and programs that run in a folder."""

import os
import re
import runpy
import shutil
import signal
import subprocess
import sys
import traceback
from contextlib import ExitStack, chdir, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import yaml

from tests.glove_data import ROOT, SMALL

#: A system without a network, on recordings beside params.yaml
SENSORS = (
    *SMALL,
    "data.source=metadata.mat",
    "model.system=sensors",
    "model.members=[kernel]",
    "device=cpu",
)
#: Options of the stages' inputs and outputs
FILES = {
    "needs": "--out data/needs.json",
    "ingest": "--out data/recordings",
    "preprocess": "--recordings data/recordings --out data/frames",
    "cluster": "--needs data/needs.json --frames data/frames --out data/views",
    "pretrain": "--needs data/needs.json --frames data/frames --out models/backbone.pt",
    "finetune": (
        "--frames data/frames --views data/views --backbone models/backbone.pt "
        "--out models/classifier.pt"
    ),
    "evaluate": (
        "--recordings data/recordings --frames data/frames --classifier models/classifier.pt "
        "--records runs --out results"
    ),
}


def record_of(stage) -> str:
    """Return the path of a stage's record."""
    return f"{'results' if stage == 'evaluate' else 'runs'}/{stage}.json"


def sh(*words, cwd, **variables):
    """Return the output of a command that runs without DVC's and MLflow's settings from here."""
    environment = {
        key: value for key, value in os.environ.items() if not key.startswith(("DVC_", "MLFLOW_"))
    }
    environment |= {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    } | variables
    done = subprocess.run(
        list(map(str, words)), cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def ran(output) -> list[str]:
    """Return the stages that DVC says it ran, in its order."""
    return re.findall(r"^Running stage '(?:.*:)?(\w+)'", output, re.MULTILINE)


def copy_repository(place, without=()) -> None:
    """Return all files of this repository, except the files that git ignores."""
    for name in sh("git", "ls-files", "-co", "--exclude-standard", cwd=ROOT).splitlines():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_file() and name not in without:
            shutil.copy(ROOT / name, place / name)


def commit(place) -> None:
    """Commit all files of a folder to git."""
    for words in (
        "init -q",
        "config user.name t",
        "config user.email t@localhost",
        "add -A",
        "commit -qm files",
    ):
        sh("git", *words.split(), cwd=place)


def set_params(place, section, **values) -> None:
    """Put values into a section of params.yaml."""
    tree = yaml.safe_load((place / "params.yaml").read_text())
    tree[section] |= values
    (place / "params.yaml").write_text(yaml.safe_dump(tree, sort_keys=False))


def run_stage(name, *words, cwd, store="disabled", clock=lambda: 0.0):
    """Run a stage from its command line in this process, and return exit code and output.

    The stage tells its progress by `clock`.
    """
    program = str(ROOT / "stages" / f"{name}.py")
    return captured(
        lambda: runpy.run_path(program, run_name="__main__"),
        *words,
        cwd=cwd,
        store=store,
        clock=clock,
    )


def captured(call, *words, cwd, store="disabled", clock=lambda: 0.0):
    """Call a function with these words as its command line, and return exit code and output."""
    before, code, out, err = signal.getsignal(signal.SIGTERM), 0, StringIO(), StringIO()
    with ExitStack() as stack:
        stack.enter_context(
            patch.dict(os.environ, {"MLFLOW_TRACKING_URI": store, "DVC_ROOT": str(cwd)})
        )
        stack.enter_context(patch.object(sys, "argv", ["stage", *map(str, words)]))
        stack.enter_context(patch("tactile_viewgcn.progress.clock", clock))
        for manager in (chdir(cwd), redirect_stdout(out), redirect_stderr(err)):
            stack.enter_context(manager)
        stack.callback(signal.signal, signal.SIGTERM, before)
        try:
            call()
        except SystemExit as end:
            code = end.code
        except Exception:
            code = 1
            traceback.print_exc()
    return SimpleNamespace(returncode=code, stdout=out.getvalue(), stderr=err.getvalue())


def changed(*changes):
    """Return changes of parameters as words of a command line."""
    return [word for change in changes for word in ("--set", change)]


def refused(result) -> str:
    """Return the one line of a refused run."""
    lines = result.stderr.strip().splitlines()
    assert result.returncode == 1, result.stderr
    assert len(lines) == 1 and lines[0].startswith("Error: "), result.stderr
    return lines[0]


def left(place) -> set[str]:
    """Return the names of the files that stages have written into a folder."""
    return {path.name for path in place.iterdir()} - {
        "params.yaml",
        "metadata.mat",
        "recordings",
        "ingest.json",
    }
