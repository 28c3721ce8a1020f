"""DVC's queue of experiments, by the names of a study's cells."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from studies.cells import RESULTS
from studies.grid import Cell
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.markdown_tables import VIRTUAL
from tactile_viewgcn.params import load


def settings(cell: Cell) -> list[str]:
    """The cell's changes as `dvc exp run --set-param` takes them, the last one of each key.

    The source becomes an absolute path: an experiment runs in another folder, and sees no file that is not tracked.

    Raises:
        UserError: there is no such source.
    """
    last = dict(change.split("=", 1) for change in cell.changes)
    source = load("params.yaml", cell.changes).data.source
    if source != VIRTUAL:
        if not Path(source).exists():
            raise UserError(f"data.source is {source}; expected a file or folder that is there")
        last["data.source"] = str(Path(source).resolve())
    return [f"{key}={value}" for key, value in last.items()]


class DvcQueue:
    """The queue of the repository in the working folder."""

    def __init__(self) -> None:
        from dvc.repo import Repo

        self._repo = Repo()
        self._suspects: set[str] = set()  # of being orphans, at the last look
        # the experiments' `python` is this one
        self._environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}

    def finished(self) -> dict[str, str]:
        """Commits of all experiments that have ended well, by name."""
        refs = ["git", "for-each-ref", "--format=%(objectname) %(refname)", "refs/exps/"]
        lines = subprocess.run(refs, capture_output=True, text=True, check=True).stdout.split("\n")
        return {name.rsplit("/", 1)[-1]: sha for sha, _, name in (line.partition(" ") for line in lines) if name}

    def status(self) -> dict[str, str]:
        """Queued, Running, Failed or Success, by name."""
        return {entry["name"]: entry["status"] for entry in self._repo.experiments.celery_queue.status()}

    def put(self, cells: dict[str, Cell]) -> None:
        """Queue cells, by name, in one process, as `dvc exp run --queue` would spend most of its time on starting.

        It is not interrupted with this one: DVC changes params.yaml for a moment and back.
        """
        self._python("studies.put", text=json.dumps({name: settings(cell) for name, cell in cells.items()}))

    def start(self, jobs: int) -> None:
        """Start as many workers, where they do not run yet; they end with the queue."""
        # the workers inherit its output: a pipe would stay open as long as they run
        command, nowhere = [sys.executable, "-m", "dvc", "queue", "start", "-j", str(jobs)], subprocess.DEVNULL
        subprocess.run(
            command, stdout=nowhere, stderr=nowhere, env=self._environment, start_new_session=True, check=True
        )

    def remove(self, names: Iterable[str]) -> None:
        """Take tasks that do not run, whatever became of them, out of the queue."""
        queue, chosen = self._repo.experiments.celery_queue, set(names)
        revisions = [entry["rev"] for entry in queue.status() if entry["name"] in chosen]
        if revisions:
            queue.remove(revisions)

    def remove_orphans(self, names: Iterable[str]) -> None:
        """Take tasks out that stand as running at two looks in a row without a worker or a process: it was killed.

        A worker alone says little: it does not answer while it ends, and then its last task still runs.
        """
        queue, chosen = self._repo.experiments.celery_queue, set(names)
        status = queue.status()
        running = {entry["rev"] for entry in status if entry["status"] == "Running" and entry["name"] in chosen}
        held = str(queue.worker_status()) if running else ""
        suspects = {revision for revision in running if revision not in held and not self._lives(revision)}
        orphans, self._suspects = suspects & self._suspects, suspects
        if orphans:
            for revision in orphans:
                with suppress(KeyError):  # one without a process
                    ended = queue.proc[revision]
                    ended.returncode = -1  # else DVC kills what has its number now
                    queue.proc[revision] = ended
            queue.kill(orphans, force=True)
            queue.remove(orphans)

    def _lives(self, revision: str) -> bool:
        """Whether its process is there: on Linux told from another of its number, as on the machine that resumes it."""
        try:
            pid = self._repo.experiments.celery_queue.proc[revision].pid
            if Path("/proc/self").exists():
                return revision in Path(f"/proc/{pid}/cmdline").read_text()
            os.kill(pid, 0)
        except (KeyError, OSError):
            return False
        return True

    def last_line(self, name: str) -> str:
        """The stage's error in the log of a failed experiment, else DVC's own, else its last line."""
        log = self._dvc("queue", "logs", name, check=False)
        lines = [line.strip() for line in log.splitlines() if line.strip()] or ["no log"]
        for form in (r"\w*(Error|Exception): ", r"ERROR: "):
            if errors := [line for line in lines if re.match(form, line)]:
                return errors[-1]
        return lines[-1]

    def results(self, revision: str) -> dict[str, bytes]:
        """The files that a finished cell is kept as, from DVC's cache or else its remote.

        Raises:
            FileNotFoundError: neither has them.
            UserError: the remote does not answer, or refuses.
        """
        from dvc.api import DVCFileSystem

        files = DVCFileSystem(rev=revision)
        try:
            return {name: files.cat_file(f"results/{name}") for name in RESULTS}
        except FileNotFoundError:
            raise
        except Exception as error:  # each kind of remote has its own
            raise UserError(f"DVC's remote: {type(error).__name__}: {error}") from error

    def forget(self, name: str) -> None:
        """Remove a finished experiment."""
        self._dvc("exp", "remove", name)
        self.remove([name])

    def _dvc(self, *words: str, check: bool = True) -> str:
        return self._python("dvc", *words, check=check)

    def _python(self, module: str, *words: str, text: str = "", check: bool = True) -> str:
        """What a module prints that is run in a process of its own, which Ctrl-C does not reach."""
        result = subprocess.run(
            [sys.executable, "-m", module, *words],
            input=text,
            capture_output=True,
            text=True,
            env=self._environment,
            start_new_session=True,
            check=False,
        )
        if check and result.returncode:
            last = (result.stderr.strip() or result.stdout.strip()).splitlines()[-1:]
            raise UserError(f"{' '.join([module, *words])} ended with {result.returncode}: {''.join(last)}")
        return result.stdout
