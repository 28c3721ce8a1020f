"""Run the missing cells of a study as DVC experiments: here, or on Dask's workers."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from platform import node
from threading import Lock
from time import monotonic
from traceback import format_exc

from joblib import Parallel, delayed, parallel_config

from studies.cells import RESULTS, STORE, answers_of, code_of_stages, key_of, store, stored
from studies.grid import Cell
from tactile_viewgcn.evaluation.trials import WHOLE
from tactile_viewgcn.files import readable
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import VIRTUAL, default_params
from tactile_viewgcn.schema import as_change, flatten

one_reader = Lock()  # threads must not read DVC's index of the cache at the same time
DVC = ("-P", "-m", "dvc", "--wait-for-lock")  # options of Python, and DVC's own


def run_cells(
    name: str, cells: dict[str, Cell], *, jobs: int = 1, scheduler: str | None = None
) -> dict[str, str]:
    """Run every cell that is not stored, and store its results.

    Prints the seconds and the error rate of each cell, or why it failed. A reason that was printed
    before is not repeated; the line names the cell that failed for it first.

    Args:
        name: name of the study.
        cells: the cells, by their keys.
        jobs: how many cells run at once, if there is no scheduler.
        scheduler: address of Dask's scheduler.

    Returns:
        The faults of cells that failed, by their keys.

    Raises:
        UserError: Dask is not installed, there is no such scheduler, or it has no worker.
    """
    missing = [key for key in cells if not stored(key)]
    commit = git("rev-parse", "HEAD").strip()
    faults: dict[str, str] = {}
    with workers(jobs, scheduler) as parallel:
        tasks = (delayed(run_cell)(f"{name}-{key}", key, cells[key], commit) for key in missing)
        for count, (key, contents, text) in enumerate(parallel(tasks), start=1):
            outcome = text
            for other, fault in faults.items():
                if fault == text:
                    outcome = f"failed: for the same reason as {cells[other]}"
                    break
            line = f"{cells[key]}: {outcome}; {len(missing) - count} left\n"
            print(line, end="", flush=True)
            if contents:
                store(key, contents)
            else:
                faults[key] = text
    return faults


@contextmanager
def workers(jobs: int, scheduler: str | None) -> Iterator[Parallel]:
    """Yield the pool that runs the cells: threads of this process, or Dask's workers.

    Each thread waits for a process of DVC.

    Args:
        jobs: number of threads.
        scheduler: address of Dask's scheduler; None for threads.

    Raises:
        UserError: Dask is not installed, there is no such scheduler, or it has no worker.
    """
    if not scheduler:
        yield Parallel(
            jobs,
            return_as="generator_unordered",
            backend="threading",
            pre_dispatch="n_jobs",
            batch_size=1,
        )
        return
    try:
        from distributed import Client
    except ImportError:
        raise UserError("--scheduler needs Dask; type `pip install -e '.[cluster]'`") from None
    try:
        client = Client(scheduler)
    except (OSError, ValueError) as error:
        raise UserError(
            f"--scheduler is {scheduler}: {error}; "
            "expected the address that `dask scheduler` prints"
        ) from None
    with client, parallel_config("dask", client=client):
        if not client.ncores():
            raise UserError(
                f"--scheduler is {scheduler}: it has no worker; start one as in docs/cluster.md"
            )
        yield Parallel(return_as="generator_unordered", pre_dispatch="all", batch_size=1)


def run_cell(
    experiment: str, key: str, cell: Cell, commit: str
) -> tuple[str, dict[str, bytes], str]:
    """Run a cell as `dvc exp run --temp`, unless its experiment exists already.

    The cell runs in the repository of the working folder. A Dask worker has a clone of its own.
    Nothing is raised, since an exception would stop the other cells.

    Args:
        experiment: name of DVC's experiment.
        key: key of the cell.
        cell: the cell.
        commit: commit of the study.

    Returns:
        The key, the contents of the files `RESULTS`, and a text with the seconds and the error
            rate. If the cell failed, there are no contents, and the text says why.
    """
    place = f"{node()}:{Path.cwd()}"
    start = monotonic()
    try:
        head = git("rev-parse", "HEAD").strip()
        if head != commit:
            raise UserError(
                f"this clone is at commit {head[:9]}; expected {commit[:9]}, the study's commit"
            )
        revision = experiments().get(experiment) or trained(experiment, key, cell)
        # the results of an experiment that exists come from DVC's cache
        remedy = f"to run it again: dvc exp remove {experiment} && rm -r $(dvc cache dir)/runs"
        with readable(f"experiment {experiment}", "its results cannot be read", remedy):
            contents = results(revision)
            error = 100 * answers_of(cell, contents).predictions.trials[WHOLE].errors.mean()
        return key, contents, f"{monotonic() - start:,.0f} s, {error:.1f} % of recordings wrong"
    except UserError as error:
        return key, {}, f"failed: {' '.join(str(error).split())} ({place})"
    except Exception:
        # a fault of this project keeps its traceback
        return key, {}, f"failed: {place}: {format_exc().strip()}"


def trained(experiment: str, key: str, cell: Cell) -> str:
    """Train a cell as DVC's experiment, and return the commit of the experiment.

    Args:
        experiment: name of DVC's experiment.
        key: key of the cell when the study began.
        cell: the cell.

    Raises:
        UserError: the cell failed, or code or data have changed since the study began.
    """
    from dvc.repo import Repo

    # under DVC's lock: while another cell starts, DVC hides code that is not committed
    with Repo(_wait_for_lock=True) as repo, repo.lock:
        if key_of(cell, code_of_stages()) != key:
            raise UserError("code or data have changed since the study began; undo the change")
    # in one write, so that lines of two threads do not merge
    print(f"{cell} ...\n", end="", flush=True)
    command = [sys.executable, *DVC, "exp", "run", "--temp", "--name", experiment]
    for change in settings(cell):
        command += ["--set-param", change]
    # so that the experiment's `python` is the one that runs here
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"PATH": path}
    log = STORE / f"{experiment}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("w") as file:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=file, stderr=file, env=environment
        )
        try:
            process.wait()
        # Ctrl-C in a terminal reaches DVC too; wait until it has removed the experiment's folder
        except KeyboardInterrupt:
            process.wait()
            raise
    commit = experiments().get(experiment)
    if not commit:
        raise UserError(f"{last_error(log.read_text(errors='replace'))}; see {log}")
    log.unlink()
    return commit


def settings(cell: Cell) -> list[str]:
    """Return every parameter of the cell for `dvc exp run --set-param`.

    All are named, since params.yaml can change while the study runs. `++` also sets a key that the
    file lacks. The source becomes an absolute path, since an experiment runs in another folder.
    """
    values = flatten(default_params(cell.changes))
    if values["data.source"] != VIRTUAL:
        values["data.source"] = str(Path(values["data.source"]).resolve())
    return [f"++{as_change(key, value)}" for key, value in values.items()]


def experiments() -> dict[str, str]:
    """Return the commits of all successful experiments, by name."""
    commits = {}
    for line in git("for-each-ref", "--format=%(objectname) %(refname)", "refs/exps/").splitlines():
        commit, reference = line.split()
        commits[reference.rpartition("/")[2]] = commit
    return commits


def results(revision: str) -> dict[str, bytes]:
    """Return the contents of `RESULTS` of a finished experiment, from DVC's cache or its remote.

    Args:
        revision: commit of the experiment.
    """
    from dvc.api import DVCFileSystem

    with one_reader:
        files = DVCFileSystem(rev=revision)
        return {name: files.cat_file(name) for name in RESULTS}


def last_error(log: str) -> str:
    """Return the last error of a Python program in a log, or else DVC's last error, if any."""
    for pattern in (r"^\w*(?:Error|Exception): .*", r"^ERROR: .*"):
        errors: list[str] = re.findall(pattern, log, re.MULTILINE)
        if errors:
            return errors[-1]
    return "no error in the log"


def git(*words: str) -> str:
    """Return the output of git.

    Raises:
        CalledProcessError: git ended with an error.
    """
    return subprocess.run(["git", *words], capture_output=True, text=True, check=True).stdout
