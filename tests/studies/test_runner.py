"""What runs, what is taken up and what is told, with a queue whose doings are chosen."""

import io
import json

import numpy as np
import pytest

from studies import cells as cells_module
from studies.cells import stored
from studies.grid import Cell
from studies.runner import WIDTH, progress, run_cells

CELLS = {f"{number:016x}": Cell(f"variant {number}", 0, 0, 0, ()) for number in range(3)}


class FakeQueue:
    """A queue that runs the first cell that waits between two looks at it, and fails those in `failing`."""

    def __init__(self, *failing):
        self.failing, self.tasks, self.done, self.ran, self.removed, self.lost = failing, {}, {}, [], [], set()
        self.diverged = set()

    def finished(self):
        return dict(self.done)

    def status(self):
        return dict(self.tasks)

    def put(self, cells):
        for name in cells:
            assert name not in self.tasks
            self.tasks[name] = "Queued"

    def start(self, jobs):
        self.jobs = jobs

    def work(self, seconds):
        name = next(name for name, state in self.tasks.items() if state == "Queued")
        self.ran.append(name)
        self.tasks[name] = "Failed" if name in self.failing else "Success"
        if name not in self.failing:
            self.done[name] = f"commit of {name}"

    def remove(self, names):
        for name in list(names):
            self.removed.append(name)
            self.tasks.pop(name, None)

    def remove_orphans(self, names):
        for name in self.lost & set(names):
            self.tasks.pop(name, None)

    def last_line(self, name):
        return "Error: the glove is on fire"

    def results(self, revision):
        if revision == "lost":
            raise FileNotFoundError
        metrics = {"diverged_in_epoch": {"finetune": 2.0}} if revision in self.diverged else {}
        file = io.BytesIO()
        np.savez(file, labels=np.zeros(1))
        return {
            "predictions.npz": file.getvalue(),
            "metrics.json": json.dumps(metrics).encode(),
            "timing.json": b"{}",
        }

    def forget(self, name):
        del self.done[name]
        self.tasks.pop(name, None)


@pytest.fixture(autouse=True)
def _store(tmp_path, monkeypatch):
    monkeypatch.setattr(cells_module, "STORE", tmp_path)


def names(*numbers):
    return [f"made-{number:016x}" for number in numbers]


def run(queue, cells=CELLS):
    return run_cells("made", cells, queue, wait=queue.work)


def test_every_cell_runs_once_and_none_a_second_time(capsys):
    queue = FakeQueue()
    assert run(queue) == {}
    assert queue.ran == names(0, 1, 2)
    assert all(stored(key) for key in CELLS)
    told = capsys.readouterr().out.splitlines()
    assert [line for line in told if "of 3" in line] == [
        f"{number + 1} of 3: variant {number}, seed 0, deal 0, fold 0" for number in range(3)
    ]
    again = FakeQueue()
    run(again)
    assert again.ran == []


class SlowQueue(FakeQueue):
    """The same, in which a cell runs at one look and has ended at the next."""

    def work(self, seconds):
        if "Running" in self.tasks.values():
            self.tasks = {name: "Queued" if state == "Running" else state for name, state in self.tasks.items()}
            super().work(seconds)
        else:
            self.tasks[next(name for name, state in self.tasks.items() if state == "Queued")] = "Running"


def test_what_runs_is_told_as_soon_as_it_runs(capsys):
    cells = {key: Cell(cell.variant, 3, 1, 2, ()) for key, cell in CELLS.items()}
    run(SlowQueue(), cells)
    told = [line.partition(" |")[0] for line in capsys.readouterr().out.splitlines()]
    assert told == [
        "1 of 3: variant 0, seed 3, deal 1, fold 2 ...",
        "made: 0 done, 1 running, 2 waiting",
        "2 of 3: variant 1, seed 3, deal 1, fold 2 ...",
        "made: 1 done, 1 running, 1 waiting",
        "3 of 3: variant 2, seed 3, deal 1, fold 2 ...",
        "made: 2 done, 1 running, 0 waiting",
    ]


def test_a_failed_cell_is_named_with_its_error_and_the_others_go_on(capsys):
    queue = FakeQueue(*names(1))
    assert run(queue) == {f"{1:016x}": "Error: the glove is on fire"}
    assert queue.ran == names(0, 1, 2)
    assert "variant 1, seed 0, deal 0, fold 0 failed: Error: the glove is on fire" in capsys.readouterr().out


def test_a_stopped_study_is_taken_up_where_it_was():
    queue = FakeQueue()
    queue.done = {names(0)[0]: "commit"}  # finished, and nobody has collected it
    queue.tasks = {names(0)[0]: "Success", names(1)[0]: "Queued"}  # waits since then
    assert run(queue) == {}
    assert queue.ran == names(1, 2)


def test_what_failed_or_lost_its_worker_blocks_nothing():
    queue = FakeQueue()
    queue.tasks = {names(0)[0]: "Failed", names(1)[0]: "Running"}
    queue.lost = set(names(1))
    assert run(queue) == {}
    assert sorted(queue.ran) == names(0, 1, 2)
    assert names(0)[0] in queue.removed


def test_a_finished_cell_that_the_cache_has_lost_runs_again():
    queue = FakeQueue()
    queue.done, queue.tasks = {names(0)[0]: "lost"}, {names(0)[0]: "Success"}
    assert run(queue) == {}
    assert sorted(queue.ran) == names(0, 1, 2)


def test_a_pulled_cell_whose_files_are_nowhere_is_told_and_neither_removed_nor_run():
    queue = FakeQueue()
    queue.done = {names(0)[0]: "lost"}
    (fault,) = run(queue).values()
    assert "in no cache and no remote" in fault and f"dvc exp remove {names(0)[0]}" in fault
    assert queue.ran == names(1, 2) and names(0)[0] in queue.done


def test_a_diverged_training_is_no_cell_of_a_study():
    queue = FakeQueue()
    queue.diverged = {f"commit of {names(2)[0]}"}
    (fault,) = run(queue).values()
    assert "finetune diverged in epoch 2" in fault
    assert not stored(f"{2:016x}")


def test_progress_fits_eighty_columns_and_says_how_long_it_takes():
    first = progress("a_study_with_a_name", 120, before=20, done=0, failed=0, running=2, seconds=600)
    assert "20 done, 2 running, 98 waiting" in first
    assert "10:00 gone, ? left" in first
    later = progress("a_study", 120, before=20, done=9, failed=1, running=2, seconds=600)
    assert "29 done, 2 running, 88 waiting, 1 failed | 10:00 gone, 1:30:00 left" in later
    assert max(len(later), len(progress("x" * 90, 3, 1, 0, 0, 1, 1))) <= WIDTH
