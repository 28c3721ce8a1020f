"""A cell as a DVC experiment of the repository in the working folder, which for a Dask worker is a separate clone."""

import os
import re
import subprocess
import sys
import time
from functools import cache
from pathlib import Path
from platform import node
from threading import Lock

from tqdm import tqdm

from studies.cells import RESULTS, STORE, code_of_stages, key_of
from studies.grid import Cell
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import VIRTUAL, load

BUSY = 300.0  # seconds for which other experiments may hold DVC's lock, or have params.yaml changed
REFUSAL = 30.0  # seconds after which DVC has refused its lock at the latest; a longer attempt has trained
TIED_DVC = Path(__file__).with_name("tied_dvc.py")  # by path: the working folder may have a different `studies`
REFUSED = re.compile(r"^ERROR: (Unable to acquire lock|.* is busy)", re.MULTILINE)
ended: set[str] = set()  # calls of `run_cells` that were stopped: none of their cells is tried again
one_reader = Lock()  # threads must not share DVC's index of the cache


def run_cell(experiment: str, key: str, cell: Cell, run: str, commit: str = "") -> dict[str, bytes]:
    """Run a cell as `dvc exp run --temp`, unless its experiment exists already; return the contents of its `RESULTS`.

    Args:
        run: the call of `run_cells`, see `end_cells`.
        commit: commit at which a worker's clone has to be.

    Raises:
        UserError: the cell failed, with the last error of its log; or code, parameters or data are not the study's.
    """
    place, log = f"{node()}:{Path.cwd()}", STORE / f"{experiment}.log"
    if not (head := git("rev-parse", "HEAD")).startswith(commit):
        raise UserError(f"{place} is at commit {head[:9]}; expected {commit[:9]}, the study's")
    tqdm.write(f"{cell} ...")
    waited, fault, busy = 0.0, "", True
    while (revision := experiments().get(experiment)) is None:
        if run in ended:
            raise UserError("stopped")
        if not busy or waited > BUSY:
            raise UserError(f"{fault} ({place}/{log})")
        begin = time.monotonic()
        if key_of(cell, code_of_stages()) == key:
            fault, busy = attempt(experiment, cell, run, log)
        else:  # for good, or for the seconds in which DVC changes params.yaml to start a different cell
            fault = "code, params.yaml or data have changed since the study began"
            time.sleep(1)
        waited += min(time.monotonic() - begin, REFUSAL)
    log.unlink(missing_ok=True)
    return results(experiment, revision)


def attempt(experiment: str, cell: Cell, run: str, log: Path) -> tuple[str, bool]:
    """Run DVC once; return the last error of its log, and whether DVC only refused its lock.

    DVC may refuse the lock after the experiment is done. Without an error there may be no experiment yet: of two that
    start at once DVC may run both in one process.
    """
    words = [word for change in settings(cell) for word in ("--set-param", change)]
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # the experiment's `python` is this one
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("w") as stream:
        done = subprocess.run(
            [sys.executable, "-P", TIED_DVC, "exp", "run", "--temp", "--name", experiment, *words],
            stdin=tie(run)[0],
            stdout=stream,
            stderr=subprocess.STDOUT,
            env=os.environ | {"PATH": path},
            check=False,
        )
    text = log.read_text(errors="replace")
    return last_error(text), not done.returncode or bool(REFUSED.search(text))


def settings(cell: Cell) -> list[str]:
    """The last of the cell's changes of each key, for `dvc exp run --set-param`.

    The source becomes an absolute path: an experiment runs in a separate folder without untracked files.
    """
    last = dict(change.split("=", 1) for change in cell.changes)
    source = load("params.yaml", cell.changes).data.source
    if source != VIRTUAL:
        last["data.source"] = str(Path(source).resolve())
    return [f"{key}={value}" for key, value in last.items()]


def experiments() -> dict[str, str]:
    """Commits of all successful experiments, by name."""
    lines = git("for-each-ref", "--format=%(objectname) %(refname)", "refs/exps/").splitlines()
    return {ref.rpartition("/")[2]: commit for commit, ref in map(str.split, lines)}


def results(experiment: str, revision: str) -> dict[str, bytes]:
    """The contents of `RESULTS` of a finished experiment.

    Raises:
        UserError: neither DVC's cache nor its remote has them any more.
    """
    from dvc.api import DVCFileSystem

    try:
        with one_reader:
            files = DVCFileSystem(rev=revision)
            return {name: files.cat_file(f"results/{name}") for name in RESULTS}
    except FileNotFoundError as error:
        raise UserError(f"{error} is not in DVC's cache; to run it again: dvc exp remove {experiment}") from None


def last_error(log: str) -> str:
    """The last error of a Python program in a log, else DVC's last error, else the last line."""
    lines = [line.strip() for line in log.splitlines() if line.strip()]
    for form in (r"\w*(Error|Exception): ", r"ERROR: "):
        if errors := [line for line in lines if re.match(form, line)]:
            return errors[-1]
    return (lines or ["no log"])[-1]


@cache
def tie(run: str) -> tuple[int, int]:
    """The pipe between the cells of one call of `run_cells` and this process: their end to read, this process's end."""
    return os.pipe()


def end_cells(run: str) -> None:
    """End those cells of one call of `run_cells` that this process runs."""
    ended.add(run)
    os.close(tie(run)[1])


def git(*words: str) -> str:
    return subprocess.run(["git", *words], capture_output=True, text=True, check=True).stdout
