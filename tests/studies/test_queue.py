"""DVC's own queue, in repositories of their own: a rehearsal, a queue that was killed, a cell that was pushed."""

import csv
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from studies import cells as cells_module
from studies import queue as queue_module
from studies import runner
from studies.cells import RESULTS
from studies.grid import Cell
from studies.queue import Queue, lives, settings
from studies.runner import run_cells
from tactile_viewgcn.errors import UserError
from tests.small_tables import ROOT
from tests.stages.running import sh

CELLS = {f"{seed:016x}": Cell(variant="a", seed=seed, deal=0, fold=0, changes=(f"seed={seed}",)) for seed in range(2)}
CELL, NAMES = CELLS[f"{0:016x}"], [f"made-{key}" for key in CELLS]
#: A cell appends to a file outside of its experiment; the second one, at its first run, does not end.
STAGE = """stages:
  evaluate:
    cmd: >-
      grep ^seed: params.yaml >> {log} && mkdir -p results && echo '{{}}' |
      tee results/predictions.npz results/metrics.json results/timing.json &&
      if grep -q "^seed: 1" params.yaml && mkdir {log}.stuck; then sleep 300; fi
    params: [seed]
    outs: [results/predictions.npz, results/metrics.json, results/timing.json]
"""


def identify(place):
    sh("git", "config", "user.name", "test", cwd=place)
    sh("git", "config", "user.email", "test@example.org", cwd=place)


def clone(bare, place):
    sh("git", "clone", "-q", bare, place, cwd=bare.parent)
    identify(place)
    return place


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A clone with one stage, in which the test runs; its cells are stored beside it."""
    bare = tmp_path / "origin.git"
    sh("git", "init", "-q", "--bare", bare, cwd=tmp_path)
    machine = clone(bare, tmp_path / "machine")
    sh("dvc", "init", "-q", cwd=machine)
    sh("dvc", "remote", "add", "-q", "-d", "store", tmp_path / "remote", cwd=machine)
    (machine / "dvc.yaml").write_text(STAGE.format(log=tmp_path / "log"))
    (machine / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    sh("git", "add", "-A", cwd=machine)
    sh("git", "commit", "-qm", "Test", cwd=machine)
    sh("git", "push", "-q", "origin", "HEAD", cwd=machine)
    monkeypatch.chdir(machine)
    monkeypatch.setattr(cells_module, "STORE", tmp_path / "cells")
    return machine


def processes_in(folder):
    """The processes that DVC runs in a folder or below it, but for this one."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if (process / "cwd").readlink().is_relative_to(folder) and int(process.name) != os.getpid():
                yield int(process.name)
        except OSError:
            continue


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # the warnings are DVC's own
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc to find its processes in")
def test_a_killed_queue_is_taken_up_and_what_had_finished_does_not_run_again(machine, tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "POLL", 0.5)
    queue = Queue()
    for name, cell in zip(NAMES, CELLS.values(), strict=True):
        queue.put(name, cell)
    queue.start(1)
    deadline = time.monotonic() + 120
    while not (tmp_path / "log.stuck").exists():
        assert time.monotonic() < deadline
        time.sleep(0.5)
    for pid in processes_in(machine):
        os.kill(pid, signal.SIGKILL)
    assert list(queue.finished()) == NAMES[:1]
    assert queue.tasks()[NAMES[1]][0] == "Running"  # for ever, says DVC
    assert run_cells("made", CELLS, Queue()) == {}
    lines = (tmp_path / "log").read_text().splitlines()  # of params.yaml, a comment behind the value
    assert [line.split()[:2] for line in lines] == [["seed:", "0"], ["seed:", "1"], ["seed:", "1"]]
    assert all(cells_module.stored(key) for key in CELLS)


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_pulled_cell_is_finished_with_its_files_or_without_and_nothing_is_queued(machine, tmp_path, monkeypatch):
    sh("dvc", "exp", "run", "-q", "--name", NAMES[0], cwd=machine)
    sh("dvc", "exp", "push", "-q", "origin", cwd=machine)
    monkeypatch.setattr(Queue, "put", lambda queue, name, cell: pytest.fail(f"queued {cell}"))
    for name, options in (("desk", []), ("other_desk", ["--no-cache"])):
        desk = clone(tmp_path / "origin.git", tmp_path / name)
        sh("dvc", "exp", "pull", "-q", *options, "origin", cwd=desk)
        assert (desk / ".dvc" / "cache").exists() != bool(options)
        monkeypatch.chdir(desk)
        monkeypatch.setattr(cells_module, "STORE", tmp_path / "cells" / name)
        key, cell = next(iter(CELLS.items()))
        assert run_cells("made", {key: cell}, Queue(), wait=lambda _: pytest.fail("waits")) == {}
        files = {file.name: file.read_text() for file in (tmp_path / "cells" / name / key).iterdir()}
        assert files == dict.fromkeys(RESULTS, "{}\n")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc tells processes apart")
def test_a_process_is_told_from_another_that_has_its_number(tmp_path, monkeypatch):
    monkeypatch.setattr(queue_module, "RUNS", tmp_path)
    alive = subprocess.Popen([sys.executable, "-S", "-c", "input()", "exec-run of 1alive1"], stdin=subprocess.PIPE)
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    for revision, pid in (("1alive1", alive.pid), ("2dead22", ended.pid), ("3reused", os.getpid())):
        (tmp_path / f"{revision}ffff").mkdir()
        (tmp_path / f"{revision}ffff" / f"{revision}ffff.json").write_text(f'{{"pid": {pid}}}')
    assert [lives(revision) for revision in ("1alive1", "2dead22", "3reused", "4early4")] == [True, False, False, False]
    alive.communicate()


def test_a_task_is_given_up_at_the_second_look_without_a_process_and_no_other_is_interrupted(tmp_path, monkeypatch):
    said = []
    monkeypatch.setattr(queue_module, "RUNS", tmp_path)
    monkeypatch.setattr(queue_module, "_dvc", lambda *words: said.append(words))
    monkeypatch.setattr(Queue, "tasks", lambda queue: {"made": ("Running", "3reused")})
    (tmp_path / "3reusedffff").mkdir()
    (tmp_path / "3reusedffff" / "3reusedffff.json").write_text(f'{{"pid": {os.getpid()}, "returncode": null}}')
    queue = Queue()
    queue.remove_killed(["made"])
    assert said == []
    queue.remove_killed(["made"])
    assert said == [("queue", "kill", "made"), ("queue", "remove", "made")]
    assert '"returncode": -1' in (tmp_path / "3reusedffff" / "3reusedffff.json").read_text()  # DVC signals nobody
    queue.remove_killed(["another study's"])
    assert len(said) == 2


@pytest.mark.parametrize(
    ("log", "fault"),
    [
        ("Running\nError: views is 0\nERROR: failed to reproduce 'cluster'\nWrite to us", "Error: views is 0"),
        ("Reproducing\nERROR: s3 is supported\n\nWrite to us\n", "ERROR: s3 is supported"),
        ("", "no log"),
    ],
)
def test_a_failed_cell_has_the_stage_s_error_or_else_dvc_s(monkeypatch, log, fault):
    monkeypatch.setattr(queue_module, "_dvc", lambda *words: SimpleNamespace(stdout=log))
    assert Queue().fault_of("made-dead") == fault


def test_a_lock_is_waited_for_and_a_refusal_is_one_line(monkeypatch):
    answers = ["ERROR: Unable to acquire lock. Another DVC process is running", "", "Reading\nERROR: no such key"]
    monkeypatch.setattr(
        queue_module, "_dvc", lambda *words: SimpleNamespace(stderr=answers[0], returncode=bool(answers.pop(0)))
    )
    monkeypatch.setattr(queue_module.time, "sleep", lambda seconds: None)
    Queue().put("made", CELL)
    with pytest.raises(UserError, match="--name made: ERROR: no such key"):
        Queue().put("made", CELL)


def test_a_remote_that_does_not_answer_is_an_error_of_the_cell(monkeypatch):
    def cat_file(path):
        raise ConnectionError("no endpoint")

    monkeypatch.setattr("dvc.api.DVCFileSystem", lambda rev: SimpleNamespace(cat_file=cat_file))
    with pytest.raises(UserError, match="DVC's remote: ConnectionError: no endpoint"):
        Queue().results("0123abcd")


def test_an_experiment_has_the_last_change_of_a_key_and_a_source_that_it_can_read():
    cell = CELL.model_copy(update={"changes": ("views=4", "seed=1", "views=2", "data.source=tests")})
    assert settings(cell) == ["views=2", "seed=1", f"data.source={Path('tests').resolve()}"]


@pytest.mark.slow
def test_a_rehearsal_runs_every_cell_once_and_leaves_table_and_picture(tmp_path):
    place = tmp_path / "repository"
    for name in sh("git", "ls-files", "-co", "--exclude-standard", cwd=ROOT).splitlines():
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, place / name)
    sh("git", "init", "-q", cwd=place)
    identify(place)
    sh("git", "add", "-A", cwd=place)
    sh("git", "commit", "-qm", "Test", cwd=place)
    first = sh("python", "-m", "studies", "claims", "--quick", cwd=place)
    assert "2 cells, finished before: 0" in first
    with (place / "studies/.quick/claims/results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {(row["variant"], row["protocol"]) for row in rows} == {("paper", "recording"), ("maximum", "recording")}
    assert all(0 <= float(row["error"]) <= 100 for row in rows)
    assert (place / "studies/.quick/claims/results.png").stat().st_size > 1000
    assert sh("git", "status", "--porcelain", "studies", cwd=place) == ""  # its own results stay as they were
    again = sh("python", "-m", "studies", "claims", "--quick", cwd=place)
    assert "2 cells, finished before: 2" in again and "smallest difference" in again
