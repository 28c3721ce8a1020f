"""A study's cells as DVC experiments, by DVC's own commands and its Python interface."""

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

from studies.cells import RESULTS
from studies.grid import Cell
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.params import VIRTUAL, load

LOCKED = 180.0  # seconds that a worker may hold the repository's lock
ENDING = 10.0  # seconds in which a task that ends may disturb a look at the queue
RUNS = Path(".dvc/tmp/exps/run")  # where DVC (3.67) keeps the process of each task


def settings(cell: Cell) -> list[str]:
    """The cell's changes as `dvc exp run --set-param` takes them, the last one of each key.

    The source becomes an absolute path: an experiment runs in another folder, and sees no file that is not tracked.
    """
    last = dict(change.split("=", 1) for change in cell.changes)
    source = load("params.yaml", cell.changes).data.source
    if source != VIRTUAL:
        last["data.source"] = str(Path(source).resolve())
    return [f"{key}={value}" for key, value in last.items()]


class Queue:
    """DVC's queue of experiments in the repository of the working folder."""

    def __init__(self) -> None:
        self._suspects: set[str] = set()  # revisions of tasks without a process at the last look

    def finished(self) -> dict[str, str]:
        """Commits of all experiments that have ended well, by name."""
        refs = ["git", "for-each-ref", "--format=%(objectname) %(refname)", "refs/exps/"]
        lines = subprocess.run(refs, capture_output=True, text=True, check=True).stdout.splitlines()
        return {ref.rpartition("/")[2]: commit for commit, ref in map(str.split, lines)}

    def tasks(self) -> dict[str, tuple[str, str]]:
        """State, which is Queued, Running or Failed, and short revision of each task, by name.

        `dvc.api.exp_show` fails where a task ends, and removes its folder, while it is read.
        """
        begin = time.monotonic()
        while (done := _dvc("queue", "status")).returncode:
            if time.monotonic() - begin > ENDING:
                raise UserError(f"dvc queue status: {_fault(done.stderr)}")
            time.sleep(1)
        lines = map(str.split, done.stdout.splitlines())
        tasks = (words for words in lines if words and words[-1] in ("Queued", "Running", "Failed"))
        return {words[1]: (words[-1], words[0]) for words in tasks}

    def put(self, name: str, cell: Cell) -> None:
        """Queue a cell; while a worker holds the lock, try again."""
        changes = [word for change in settings(cell) for word in ("--set-param", change)]
        begin = time.monotonic()
        while (done := _dvc("exp", "run", "--queue", "--name", name, *changes)).returncode:
            if "lock" not in done.stderr or time.monotonic() - begin > LOCKED:
                raise UserError(f"dvc exp run --queue --name {name}: {_fault(done.stderr)}")
            time.sleep(1)

    def start(self, jobs: int) -> None:
        """Start workers until there are so many; they end with the queue."""
        done = _dvc("queue", "start", "--jobs", str(jobs), output=subprocess.DEVNULL)  # workers would keep a pipe open
        if done.returncode:
            raise UserError(f"dvc queue start ended with {done.returncode}")

    def remove(self, names: Iterable[str]) -> None:
        """Take tasks that do not run out of the queue."""
        if names := list(names):
            _dvc("queue", "remove", *names)

    def remove_killed(self, names: Iterable[str]) -> None:
        """Take tasks out that stand as running at two looks in a row without a process: it was killed.

        DVC leaves them running for ever. `dvc queue kill` sees that no worker has such a task, and marks it as failed.
        """
        running = {name: revision for name, (state, revision) in self.tasks().items() if state == "Running"}
        gone = {name: running[name] for name in names if name in running and not lives(running[name])}
        killed = [name for name, revision in gone.items() if revision in self._suspects]
        self._suspects = set(gone.values())
        for name in killed:
            for file in RUNS.glob(f"{gone[name]}*/*.json"):  # else DVC interrupts the process that has its number now
                file.write_text(json.dumps(json.loads(file.read_text()) | {"returncode": -1}))
            _dvc("queue", "kill", name)
        self.remove(killed)

    def fault_of(self, name: str) -> str:
        """What went wrong in a failed experiment, by its log."""
        return _fault(_dvc("queue", "logs", name).stdout)

    def results(self, commit: str) -> dict[str, bytes]:
        """The files that a finished cell is kept as, from DVC's cache or else its remote.

        Raises:
            FileNotFoundError: neither has them.
            UserError: the remote does not answer, or refuses.
        """
        from dvc.api import DVCFileSystem  # late: it takes a second

        files = DVCFileSystem(rev=commit)
        try:
            return {name: files.cat_file(f"results/{name}") for name in RESULTS}
        except Exception as error:  # each kind of remote has its own
            if isinstance(error, FileNotFoundError):
                raise
            raise UserError(f"DVC's remote: {type(error).__name__}: {error}") from error


def _fault(text: str) -> str:
    """The last error of a Python program in a text, else DVC's own, else the last line."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    for form in (r"\w*(Error|Exception): ", r"ERROR: "):
        if errors := [line for line in lines if re.match(form, line)]:
            return errors[-1]
    return (lines or ["no log"])[-1]


def lives(revision: str) -> bool:
    """Whether the process of a running task is there; on Linux told from another that has its number by now."""
    for file in RUNS.glob(f"{revision}*/*.json"):
        pid = json.loads(file.read_text())["pid"]
        try:
            if Path("/proc/self").exists():
                return revision in Path(f"/proc/{pid}/cmdline").read_text()
            os.kill(pid, 0)
        except OSError:
            return False
        return True
    return False


def _dvc(*words: str, output: int = subprocess.PIPE) -> subprocess.CompletedProcess:
    """DVC in a process of its own, which Ctrl-C does not reach: it changes params.yaml for a moment and back."""
    # the experiments' `python` is this one
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        [sys.executable, "-m", "dvc", *words],
        stdout=output,
        stderr=output,
        text=True,
        env=os.environ | {"PATH": path},
        start_new_session=True,
        check=False,
    )
