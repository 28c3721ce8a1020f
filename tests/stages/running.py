"""Stages run as their command line runs them, in this process."""

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

from tests.glove_data import ROOT
from tests.stag_files import save_matlab5


def sh(*words, cwd, **variables):
    """What a command prints, without this session's settings of DVC and MLflow."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("DVC_", "MLFLOW_"))}
    environment |= {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"} | variables
    done = subprocess.run(list(map(str, words)), cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def ran(output) -> list[str]:
    """The stages that DVC says it ran, in its order."""
    return re.findall(r"^Running stage '(?:.*:)?(\w+)'", output, re.MULTILINE)


def copy_pipeline(place) -> None:
    """What DVC needs of this repository, but for params.yaml."""
    for name in ("stages", "tactile_viewgcn"):
        shutil.copytree(ROOT / name, place / name, ignore=shutil.ignore_patterns("__pycache__"))
    (place / "data" / "virtual").mkdir(parents=True)
    for name in ("dvc.yaml", "data/virtual/dvc.yaml", ".gitignore", ".dvcignore"):
        shutil.copy(ROOT / name, place / name)


def run_stage(name, *words, cwd):
    """A stage as its command line runs it, in this process: exit code and what it prints."""
    return captured(lambda: runpy.run_path(str(ROOT / "stages" / f"{name}.py"), run_name="__main__"), *words, cwd=cwd)


def captured(call, *words, cwd):
    """A call that reads these words from the command line: exit code and what it prints."""
    before, code, out, err = signal.getsignal(signal.SIGTERM), 0, StringIO(), StringIO()
    with ExitStack() as stack:
        stack.enter_context(patch.dict(os.environ, {"MLFLOW_TRACKING_URI": "disabled", "DVC_ROOT": str(cwd)}))
        stack.enter_context(patch.object(sys, "argv", ["stage", *map(str, words)]))
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
    """Changes of parameters as words of a command line."""
    return [word for change in changes for word in ("--set", change)]


def refused(result) -> str:
    """The one line of a refused run."""
    lines = result.stderr.strip().splitlines()
    assert result.returncode == 1, result.stderr
    assert len(lines) == 1 and lines[0].startswith("Error: "), result.stderr
    return lines[0]


def ingest(place, tree=None, source="metadata.mat"):
    if tree is not None:
        save_matlab5(place / source, tree)
    words = ("--out", "recordings.h5", "--record", "ingest.json")
    return run_stage("ingest", *words, *changed(f"data.source={source}"), cwd=place)


def preprocess(place, *changes):
    outputs = ("--out", "frames.h5", "--kept", "kept.csv", "--record", "preprocess.json")
    return run_stage("preprocess", "--recordings", "recordings.h5", *outputs, *changed(*changes), cwd=place)


def left(place) -> set[str]:
    return {path.name for path in place.iterdir()} - {"params.yaml", "metadata.mat", "recordings.h5", "ingest.json"}
