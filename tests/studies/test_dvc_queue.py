"""Which tasks of DVC's queue are given up, with a queue whose tasks and workers are chosen."""

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from studies import dvc_queue


class Celery:
    """Two running tasks: `dead`, whose process has ended, and `alive`, whose process is this one."""

    def __init__(self):
        ended = subprocess.Popen([sys.executable, "-c", ""])
        ended.wait()
        self.proc = {"dead": SimpleNamespace(pid=ended.pid), "alive": SimpleNamespace(pid=os.getpid())}
        self.workers, self.killed, self.removed = {}, [], []

    def status(self):
        return [{"rev": name, "name": f"made-{name}", "status": "Running"} for name in self.proc]

    def worker_status(self):
        return self.workers

    def kill(self, revisions, force):
        self.killed += revisions

    def remove(self, revisions):
        self.removed += revisions


@pytest.fixture
def celery(monkeypatch):
    celery = Celery()
    monkeypatch.setattr("dvc.repo.Repo", lambda: SimpleNamespace(experiments=SimpleNamespace(celery_queue=celery)))
    return celery


NAMES = ["made-dead", "made-alive"]


def test_a_task_is_given_up_at_the_second_look_that_sees_neither_worker_nor_process(celery):
    queue = dvc_queue.DvcQueue()
    queue.remove_orphans(NAMES)
    assert celery.killed == []
    queue.remove_orphans(NAMES)  # no worker answers, as one that is about to end; `alive` runs all the same
    assert celery.killed == celery.removed == ["dead"]


def test_a_task_that_a_worker_has_or_that_is_another_study_s_is_left_alone(celery):
    queue = dvc_queue.DvcQueue()
    for _ in range(2):
        queue.remove_orphans(["made-alive"])
    celery.workers = {"worker": [{"args": ["dead"]}]}
    for _ in range(2):
        queue.remove_orphans(NAMES)
    assert celery.killed == []
