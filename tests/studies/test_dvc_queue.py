"""Which tasks of DVC's queue are given up, with a queue whose tasks and workers are chosen."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from studies import dvc_queue
from tactile_viewgcn.errors import UserError


class Celery:
    """Running tasks: `dead` has no process, `alive` has one, `reused` had one whose number is another's now."""

    def __init__(self, alive):
        ended = subprocess.Popen([sys.executable, "-c", ""])
        ended.wait()
        pids = {"dead": ended.pid, "alive": alive.pid, "reused": os.getpid()}
        self.proc = {revision: SimpleNamespace(pid=pid, returncode=None) for revision, pid in pids.items()}
        self.workers, self.killed, self.removed = {}, [], []

    def status(self):
        return [{"rev": name, "name": f"made-{name}", "status": "Running"} for name in self.proc]

    def worker_status(self):
        return self.workers

    def kill(self, revisions, force):
        live = [revision for revision in revisions if revision in self.proc and self.proc[revision].returncode is None]
        assert live == [], "would kill another process"
        self.killed += sorted(revisions)

    def remove(self, revisions):
        self.removed += sorted(revisions)


@pytest.fixture
def celery(monkeypatch):
    alive = subprocess.Popen([sys.executable, "-S", "-c", "input()", "exec-run of alive"], stdin=subprocess.PIPE)
    celery = Celery(alive)
    monkeypatch.setattr("dvc.repo.Repo", lambda: SimpleNamespace(experiments=SimpleNamespace(celery_queue=celery)))
    yield celery
    alive.communicate()


NAMES = ["made-dead", "made-alive"]


def test_a_task_is_given_up_at_the_second_look_that_sees_neither_worker_nor_process(celery):
    queue = dvc_queue.DvcQueue()
    queue.remove_orphans(NAMES)
    assert celery.killed == []
    queue.remove_orphans(NAMES)  # no worker answers, as one that is about to end; `alive` runs all the same
    assert celery.killed == celery.removed == ["dead"]


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc tells processes apart")
def test_a_task_whose_number_another_process_has_is_given_up(celery):
    queue = dvc_queue.DvcQueue()
    for _ in range(2):
        queue.remove_orphans(["made-reused", "made-alive"])
    assert celery.killed == celery.removed == ["reused"]


def test_a_task_whose_worker_died_before_its_process_began_is_given_up(celery):
    queue = dvc_queue.DvcQueue()
    celery.status = lambda: [{"rev": "early", "name": "made-early", "status": "Running"}]
    for _ in range(2):
        queue.remove_orphans(["made-early"])
    assert celery.killed == celery.removed == ["early"]


def test_a_task_that_a_worker_has_or_that_is_another_study_s_is_left_alone(celery):
    queue = dvc_queue.DvcQueue()
    for _ in range(2):
        queue.remove_orphans(["made-alive"])
    celery.workers = {"worker": [{"args": ["dead"]}]}
    for _ in range(2):
        queue.remove_orphans(NAMES)
    assert celery.killed == []


@pytest.mark.parametrize(
    ("log", "told"),
    [
        (
            "Running stage\nError: views is 0\nERROR: failed to reproduce 'cluster'\nTroubles? Write to us",
            "Error: views is 0",
        ),
        ("Reproducing\nERROR: s3 is supported, but\n\nTroubles? Write to us\n", "ERROR: s3 is supported, but"),
        ("Killed\n", "Killed"),
        ("", "no log"),
    ],
)
def test_a_failed_cell_tells_the_stage_s_error_or_else_dvc_s(celery, monkeypatch, log, told):
    queue = dvc_queue.DvcQueue()
    monkeypatch.setattr(queue, "_dvc", lambda *words, check: log)
    assert queue.last_line("made-dead") == told


def test_a_remote_that_does_not_answer_is_an_error_of_the_cell(celery, monkeypatch):
    class Unreachable(Exception):
        pass

    def cat_file(path):
        raise Unreachable("no endpoint")

    monkeypatch.setattr("dvc.api.DVCFileSystem", lambda rev: SimpleNamespace(cat_file=cat_file))
    with pytest.raises(UserError, match="DVC's remote: Unreachable: no endpoint"):
        dvc_queue.DvcQueue().results("0123abcd")
