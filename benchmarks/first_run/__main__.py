"""Seconds of a first run: the installation, and `dvc repro` in a fresh clone, with its errors."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.command import Result, Row, benchmark
from tactile_viewgcn.files import root
from tactile_viewgcn.params import Params
from tactile_viewgcn.provenance import processor

INSTALL = ("install", "--quiet", "-e", ".[pipeline]", "-c", "constraints.txt")
THREADS = (1, 2)
ERRORS = ("whole", "recording", "object")
SMALL = (  # the run of --quick, by the packages that are installed here
    *("-S", "glove.objects=[ball,mug]"),
    *("-S", "glove.grasps=1"),
    *("-S", "glove.grasp_frames=20"),
    *("-S", "pretrain.epochs=1"),
)
TEXT = """A first run: wall-clock seconds, and errors in % on simulated recordings. The packages are
installed into a fresh virtual environment. Each run is in a fresh clone of the commit, by
`OMP_NUM_THREADS=N dvc repro`.
"""


@benchmark
def first_run(params: Params, quick: bool) -> Result:
    """Install the packages and run the pipeline in fresh clones of the commit."""
    rows = list[Row]()
    with TemporaryDirectory(prefix="first-run-") as folder:
        python = sys.executable
        if not quick:
            clone = _clone(Path(folder, "installed"))
            environment = Path(folder, "venv")
            python = str(environment / "bin" / "python")
            begin = time.perf_counter()
            _call(sys.executable, "-m", "venv", str(environment), place=clone)
            _call(python, "-m", "pip", *INSTALL, place=clone)
            seconds = time.perf_counter() - begin
            row = {"step": "installation", "threads": "", "seconds": seconds}
            rows.append(row | dict.fromkeys(ERRORS, ""))
        for threads in THREADS:
            clone = _clone(Path(folder, str(threads)))
            command = ("exp", "run", *SMALL) if quick else ("repro",)
            begin = time.perf_counter()
            _call(python, "-m", "dvc", *command, place=clone, threads=threads)
            seconds = time.perf_counter() - begin
            summary = json.loads((clone / "results/summary.json").read_text())
            errors = {name: 100 * summary[f"error.{name}"] for name in ERRORS}
            rows.append({"step": "dvc repro", "threads": threads, "seconds": seconds} | errors)
    machine = f"{os.cpu_count()} cores of {processor()}"
    return TEXT, [row | {"machine": machine} for row in rows], None


def _clone(place: Path) -> Path:
    """Return a fresh clone of the commit of this repository."""
    _call("git", "clone", "--quiet", str(root()), str(place), place=root())
    return place


def _call(*words: str, place: Path, threads: int | None = None) -> None:
    """Run a command in a folder; raise CalledProcessError if it fails.

    Args:
        *words: the words of the command.
        place: the folder.
        threads: number of threads of each stage; None if the command trains nothing.
    """
    environment = dict(os.environ)
    for name in ("PYTHONPATH", "MLFLOW_TRACKING_URI"):  # each clone has code and a store of its own
        environment.pop(name, None)
    if threads:
        environment["OMP_NUM_THREADS"] = str(threads)
    folder = str(Path(words[0]).parent)  # `dvc repro` finds the `python` of its stages there
    if folder != ".":
        environment["PATH"] = os.pathsep.join([folder, environment.get("PATH", "")])
    subprocess.run(words, cwd=place, env=environment, check=True)


if __name__ == "__main__":
    first_run()
