"""Run stages from their command line in this process, and programs in a folder."""

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
    folder = "results" if stage == "evaluate" else "runs"
    return f"{folder}/{stage}.json"


def sh(*words, cwd, **variables):
    """Return the output of a command that runs without DVC's and MLflow's settings from here."""
    environment = {
        key: value for key, value in os.environ.items() if not key.startswith(("DVC_", "MLFLOW_"))
    }
    environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment |= variables
    words = [str(word) for word in words]
    result = subprocess.run(
        words, cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def ran(output) -> list[str]:
    """Return the stages that DVC says it ran, in its order."""
    return re.findall(r"^Running stage '(?:.*:)?(\w+)'", output, re.MULTILINE)


def copy_repository(folder, without=()) -> None:
    """Copy the files of this repository into a folder, except the files that git ignores.

    Args:
        folder: where the files are written.
        without: paths of files that are left out.
    """
    for name in sh("git", "ls-files", "-co", "--exclude-standard", cwd=ROOT).splitlines():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_file() and name not in without:
            shutil.copy(ROOT / name, folder / name)


def commit(folder) -> None:
    """Commit all files of a folder to git."""
    for words in (
        "init -q",
        "config user.name t",
        "config user.email t@localhost",
        "add -A",
        "commit -qm files",
    ):
        sh("git", *words.split(), cwd=folder)


def set_params(folder, section, **values) -> None:
    """Set values in a section of the params.yaml of a folder."""
    tree = yaml.safe_load((folder / "params.yaml").read_text())
    tree[section] |= values
    (folder / "params.yaml").write_text(yaml.safe_dump(tree, sort_keys=False))


def run_stage(name, *words, cwd, store="disabled", clock=lambda: 0.0):
    """Run a stage from its command line in this process, and return exit code and output.

    The stage tells its progress by `clock`.
    """
    program = str(ROOT / "stages" / f"{name}.py")

    def call():
        runpy.run_path(program, run_name="__main__")

    return captured(call, *words, cwd=cwd, store=store, clock=clock)


def captured(call, *words, cwd, store="disabled", clock=lambda: 0.0):
    """Call a function with these words as its command line, and return exit code and output."""
    before = signal.getsignal(signal.SIGTERM)
    code = 0
    stdout = StringIO()
    stderr = StringIO()
    with ExitStack() as stack:
        variables = {"MLFLOW_TRACKING_URI": store, "DVC_ROOT": str(cwd)}
        stack.enter_context(patch.dict(os.environ, variables))
        stack.enter_context(patch.object(sys, "argv", ["stage", *map(str, words)]))
        stack.enter_context(patch("tactile_viewgcn.progress.clock", clock))
        for manager in (chdir(cwd), redirect_stdout(stdout), redirect_stderr(stderr)):
            stack.enter_context(manager)
        stack.callback(signal.signal, signal.SIGTERM, before)
        try:
            call()
        except SystemExit as end:
            code = end.code
        except Exception:
            code = 1
            traceback.print_exc()
    return SimpleNamespace(returncode=code, stdout=stdout.getvalue(), stderr=stderr.getvalue())


def changed(*changes):
    """Return changes of parameters as words of a command line."""
    return [word for change in changes for word in ("--set", change)]


def refused(result) -> str:
    """Return the one line of a refused run."""
    lines = result.stderr.strip().splitlines()
    assert result.returncode == 1, result.stderr
    assert len(lines) == 1 and lines[0].startswith("Error: "), result.stderr
    return lines[0]


def written_files(folder) -> set[str]:
    """Return the names of the files that stages have written into a folder."""
    inputs = {"params.yaml", "metadata.mat", "recordings", "ingest.json"}
    return {path.name for path in folder.iterdir()} - inputs
