"""Cells run as DVC experiments in a small repository, where they may fail or be interrupted."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from socket import socket

import psutil
import pytest
import yaml

from studies.cells import RESULTS, STORE, code_of_stages, key_of, stored
from studies.grid import Cell
from studies.run import run_cell, run_cells, settings
from tests.glove_data import ROOT
from tests.stages.running import commit, set_params, sh
from tests.studies.test_grid import LEAST
from tests.studies.test_take import write_cell


def cell_of(seed):
    """Return the cell of a seed."""
    return Cell(variant="a", seed=seed, deal=0, fold=0, changes=(f"seed={seed}",))


CELLS = {key_of(cell, code_of_stages()): cell for cell in map(cell_of, range(4))}
KEYS = list(CELLS)
TWO = {key: CELLS[key] for key in KEYS[:2]}
#: A cell appends its seed to a file outside of its experiment. At first the second cell does not
#: end, and the third one fails.
STAGE = """stages:
  evaluate:
    cmd: >-
      sed -n 's/^seed: \\([0-9]\\).*/\\1/p' params.yaml | tee {log}.last >> {log} &&
      cp -r {cell}/* . &&
      if grep -q "^seed: 1" params.yaml && mkdir {log}.stuck; then sleep 300; fi &&
      if grep -q "^seed: 2" params.yaml && mkdir {log}.failed;
      then echo "Error: the glove is on fire"; exit 1; fi
    params: [seed]
    outs: [{outs}]
"""


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Make a repository with one stage, in which the test runs."""
    folder = tmp_path / "machine"
    sh("git", "init", "-q", folder, cwd=tmp_path)
    sh("dvc", "init", "-q", cwd=folder)
    stage = STAGE.format(log=tmp_path / "log", cell=tmp_path / "cell", outs=", ".join(RESULTS))
    (folder / "dvc.yaml").write_text(stage)
    # the other keys have their defaults
    (folder / "params.yaml").write_text("seed: 0\ncluster: {restarts: 10}\n")
    (folder / ".gitignore").write_text("/studies/\n")
    commit(folder)
    monkeypatch.chdir(folder)
    write_cell(tmp_path / "cell", 8)
    return folder


def processes_in(folder):
    """Yield the names of the processes that run in a folder or below it, except this one."""
    for process in psutil.process_iter(["cwd", "name"]):
        if Path(process.info["cwd"] or "/").is_relative_to(folder) and process.pid != os.getpid():
            yield process.info["name"]


def wait_for(condition, works=lambda: True):
    """Wait for a condition as long as `works` says that it can still come true.

    pytest's own limit ends a test that hangs.
    """
    while not condition():
        assert works() or condition()
        time.sleep(0.5)


def python(*words, cwd, **options):
    """Start a Python program of this checkout in another folder, and return its process."""
    return subprocess.Popen(
        [sys.executable, *words], cwd=cwd, env=os.environ | {"PYTHONPATH": str(ROOT)}, **options
    )


def seeds_in(log):
    return sorted(map(int, log.read_text().split()))


def with_dvc(test):
    """Mark a test that takes minutes, with DVC's and Dask's own warnings."""
    return pytest.mark.slow(pytest.mark.filterwarnings("default")(test))


@with_dvc
def test_a_failed_cell_is_named_and_the_same_command_runs_it_again_and_no_other(
    machine, tmp_path, capsys
):
    (tmp_path / "log.stuck").mkdir()
    faults = run_cells("made", CELLS, jobs=3)
    assert list(faults) == [KEYS[2]]
    assert faults[KEYS[2]].startswith("failed: Error: the glove is on fire; see")
    lines = capsys.readouterr().out.splitlines()
    assert {f"{cell} ..." for cell in CELLS.values()} < set(lines)
    assert len(lines) == 2 * len(CELLS)
    ends = [line.rpartition("; ") for line in lines if not line.endswith(" ...")]
    assert [remaining for *_, remaining in ends] == ["3 left", "2 left", "1 left", "0 left"]
    finished = r"seed [013].*: \d+ s, 50\.0 % of recordings wrong$"
    failed = r"seed 2.*: failed: Error: the glove"
    for text, *_ in ends:
        assert re.search(f"{finished}|{failed}", text)
    set_params(machine, "cluster", restarts=3)  # as if another run used the same folder
    record = tmp_path / "cell/runs/pretrain.json"
    intact = record.rename(tmp_path / "intact")
    record.write_text("{}")
    # the same experiment twice
    damaged = run_cells("made", CELLS, jobs=2)[KEYS[2]]
    again = run_cells("made", CELLS, jobs=2)[KEYS[2]]
    intact.rename(record)
    assert damaged == again
    assert "its results cannot be read (KeyError: 'notes')" in damaged
    assert "\n" not in damaged
    sh("sh", "-c", re.search(r"to run it again: (.*) \(", damaged)[1], cwd=machine)
    assert run_cells("made", CELLS, jobs=2) == {}
    assert seeds_in(tmp_path / "log") == [0, 1, 2, 2, 2, 3]
    assert all(map(stored, KEYS))
    shutil.rmtree(STORE / KEYS[0])
    assert run_cells("made", CELLS) == {}  # the results come from its experiment
    assert len(seeds_in(tmp_path / "log")) == 6
    stored_files = {file.name: file.read_bytes() for file in (STORE / KEYS[0]).iterdir()}
    assert stored_files == {
        Path(name).name: (tmp_path / "cell" / name).read_bytes() for name in RESULTS
    }


@with_dvc
@pytest.mark.parametrize("jobs", [1, 2])
def test_ctrl_c_in_a_terminal_ends_the_cells_and_the_others_are_run_later(machine, tmp_path, jobs):
    # a background job ignores the signal
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    code += f"from studies.__main__ import main; main(['made', '--jobs', '{jobs}'])"
    (machine / "studies").mkdir()
    (machine / "studies/made.yaml").write_text(yaml.safe_dump(LEAST | {"seeds": [0, 1]}))
    study = python(
        "-c", code, cwd=machine, start_new_session=True, stderr=subprocess.PIPE, text=True
    )

    def both_began():  # DVC may leave a folder as it starts
        return stored(KEYS[0]) and (tmp_path / "log.stuck").exists()

    wait_for(both_began, works=lambda: study.poll() is None)
    os.killpg(study.pid, signal.SIGINT)  # a terminal sends it to all processes too
    message = study.communicate()[1]
    assert study.returncode == 1
    assert message.startswith("stopped; finished cells are kept")
    assert message.count("\n") == 1
    wait_for(lambda: not list(processes_in(machine)))
    assert not list((machine / ".dvc/tmp/exps/standalone").glob("tmp*"))
    assert run_cells("made", TWO) == {}
    assert seeds_in(tmp_path / "log") == [0, 1, 1] and all(map(stored, TWO))


@with_dvc
def test_a_killed_worker_s_cell_goes_to_another_and_all_come_out_once(machine, tmp_path):
    pytest.importorskip("distributed", reason="Dask is not installed: pip install -e '.[cluster]'")
    (tmp_path / "log.failed").mkdir()
    with socket() as port:
        port.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{port.getsockname()[1]}"
    scheduler = f"-m dask scheduler --port {address.rpartition(':')[2]} --no-dashboard"
    dask = [python(*scheduler.split(), cwd=machine)]
    for name in ("first", "second"):
        clone = "clone -q -c user.name=t -c user.email=t@localhost"
        sh("git", *clone.split(), machine, name, cwd=tmp_path)
        worker = f"-m dask worker {address} --nthreads 1 --no-nanny --no-dashboard --name {name}"
        dask.append(python(*worker.split(), cwd=tmp_path / name))
    try:
        with ThreadPoolExecutor(1) as pool:
            study = pool.submit(run_cells, "made", CELLS, scheduler=address)
            wait_for((tmp_path / "log.stuck").exists, works=lambda: not study.done())
            workers = {"first": dask[1], "second": dask[2]}
            name = next(name for name in workers if "sleep" in processes_in(tmp_path / name))
            workers[name].kill()
            assert study.result() == {}
        assert seeds_in(tmp_path / "log") == [0, 1, 1, 2, 3]
        assert all(map(stored, KEYS))
    finally:
        for process in dask:
            process.kill()
            process.wait()


@with_dvc
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_clone_at_another_commit_and_changed_data_are_refused_before_any_work(
    machine, tmp_path, capsys, jobs
):
    assert "expected 123456789" in run_cell("made", KEYS[0], CELLS[KEYS[0]], "123456789abc")[2]
    source = tmp_path / "source"
    source.write_bytes(b"1")
    on_file = [
        replace(cell, changes=(*cell.changes, f"data.source={source}")) for cell in CELLS.values()
    ]
    cells = {key_of(cell, code_of_stages()): cell for cell in on_file}
    source.write_bytes(b"2")  # while the study runs
    assert run_cells("made", cells, jobs=jobs).keys() == cells.keys()
    printed = re.findall(r"(a, seed \d.*): failed: (.*); (\d) left\n", capsys.readouterr().out)
    names, reasons, remaining = zip(*printed, strict=True)
    assert set(names) == set(map(str, on_file))
    assert remaining == ("3", "2", "1", "0")
    assert "code or data have changed" in reasons[0]
    assert {*reasons[1:]} == {f"for the same reason as {names[0]}"}
    assert not (tmp_path / "log").exists()


def test_an_experiment_has_the_last_change_of_a_key_and_a_source_that_it_can_read():
    cell = replace(CELLS[KEYS[0]], changes=("views=4", "seed=1", "views=2", "data.source=tests"))
    expected = {
        "++views=2",
        "++seed=1",
        f"++data.source={Path('tests').resolve()}",
        "++pretrain.epochs=30",
    }
    assert expected < set(settings(cell)) and "++views=4" not in settings(cell)
