"""A cell that another clone has run and pushed, through DVC's own `exp push` and `exp pull`."""

import os
import subprocess
import sys

import pytest
from studies.dvc_queue import DvcQueue

from studies import cells as cells_module
from studies.cells import RESULTS, experiment_of
from studies.grid import Cell
from studies.runner import run_cells

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]  # the warnings are DVC's own
KEY = "0123456789abcdef"
STAGE = """stages:
  evaluate:
    cmd: >-
      mkdir -p results && cd results && echo '{"error": 0.25}' | tee predictions.npz metrics.json timing.json
    outs: [results/predictions.npz, results/metrics.json, results/timing.json]
"""


def sh(*words, cwd):
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("DVC_", "GIT_"))}
    subprocess.run(list(map(str, words)), cwd=cwd, env=environment, timeout=120, check=True)


def dvc(*words, cwd):
    sh(sys.executable, "-m", "dvc", *words, cwd=cwd)


def clone(bare, place):
    sh("git", "clone", "-q", bare, place, cwd=bare.parent)
    sh("git", "config", "user.name", "test", cwd=place)
    sh("git", "config", "user.email", "test@example.org", cwd=place)
    return place


def test_a_pulled_cell_is_finished_with_its_files_or_without_and_nothing_is_queued(tmp_path, monkeypatch):
    bare = tmp_path / "origin.git"
    sh("git", "init", "-q", "--bare", bare, cwd=tmp_path)
    machine = clone(bare, tmp_path / "machine")
    dvc("init", "-q", cwd=machine)
    dvc("remote", "add", "-q", "-d", "store", tmp_path / "remote", cwd=machine)
    (machine / "dvc.yaml").write_text(STAGE)
    sh("git", "add", "-A", cwd=machine)
    sh("git", "commit", "-qm", "Test", cwd=machine)
    sh("git", "push", "-q", "origin", "HEAD", cwd=machine)
    dvc("exp", "run", "-q", "--name", experiment_of("made", KEY), cwd=machine)
    dvc("exp", "push", "-q", "origin", cwd=machine)

    monkeypatch.setattr(DvcQueue, "put", lambda queue, cells: pytest.fail(f"queued {cells}"))
    for name, options in (("desk", []), ("other_desk", ["--no-cache"])):
        desk = clone(bare, tmp_path / name)
        dvc("exp", "pull", "-q", *options, "origin", cwd=desk)
        assert (desk / ".dvc" / "cache").exists() != bool(options)
        monkeypatch.chdir(desk)
        monkeypatch.setattr(cells_module, "STORE", tmp_path / "cells" / name)
        queue = DvcQueue()
        assert list(queue.finished()) == [f"made-{KEY}"]
        assert run_cells("made", {KEY: Cell("a", 0, 0, 0, ())}, queue, wait=lambda _: pytest.fail("waits")) == {}
        files = {file.name: file.read_text() for file in (tmp_path / "cells" / name / KEY).iterdir()}
        assert files == dict.fromkeys(RESULTS, '{"error": 0.25}\n')
