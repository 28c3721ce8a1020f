"""What runs, what is taken up and what is said, with a queue whose doings are chosen."""

import pytest

from studies import cells as cells_module
from studies.cells import stored
from studies.grid import Cell
from studies.runner import put_absent, run_cells

KEYS = [f"{number:016x}" for number in range(3)]
NAMES = [f"made-{key}" for key in KEYS]
CELLS = {key: Cell(variant=f"variant {int(key)}", seed=0, deal=0, fold=0, changes=()) for key in KEYS}


class FakeQueue:
    """A queue that ends the first cell that waits between two looks at it; those in `failing` fail."""

    def __init__(self, *failing):
        self.failing, self.states, self.done, self.ran, self.killed = failing, {}, {}, [], set()
        self.starts = 0

    def finished(self):
        return dict(self.done)

    def tasks(self):
        return {name: (state, "0123456") for name, state in self.states.items()}

    def put(self, name, cell):
        assert name not in self.states
        self.states[name] = "Queued"

    def start(self, jobs):
        self.starts += 1

    def work(self, seconds):
        name = next(name for name, state in self.states.items() if state == "Queued")
        self.ran.append(name)
        if name in self.failing:
            self.states[name] = "Failed"
        else:
            del self.states[name]
            self.done[name] = f"commit of {name}"

    def remove(self, names):
        for name in list(names):
            del self.states[name]

    def remove_killed(self, names):
        self.remove(self.killed & self.states.keys())

    def fault_of(self, name):
        return "Error: the glove is on fire"

    def results(self, commit):
        if commit == "lost":
            raise FileNotFoundError
        return {"predictions.npz": b"", "metrics.json": b"{}", "timing.json": b"{}"}


@pytest.fixture(autouse=True)
def _store(tmp_path, monkeypatch):
    monkeypatch.setattr(cells_module, "STORE", tmp_path)


def run(queue):
    return run_cells("made", CELLS, queue, wait=queue.work)


def test_a_failed_cell_is_named_with_its_error_and_the_others_go_on(capsys):
    queue = FakeQueue(NAMES[1])
    assert run(queue) == {KEYS[1]: "Error: the glove is on fire"}
    assert queue.ran == NAMES
    assert "variant 1, seed 0, deal 0, fold 0 failed: Error: the glove is on fire" in capsys.readouterr().out
    queue.failing = ()
    assert run(queue) == {}  # the same command tries it again, and no other
    assert queue.ran == [*NAMES, NAMES[1]] and all(stored(key) for key in CELLS)


def test_a_stopped_study_is_taken_up_where_it_was():
    queue = FakeQueue()
    queue.done = {NAMES[0]: "commit"}  # finished, and nobody has collected it
    queue.states = {NAMES[1]: "Queued", NAMES[2]: "Running"}  # one waits, one was under way when all was killed
    queue.killed = {NAMES[2]}
    assert run(queue) == {}
    assert queue.ran == NAMES[1:]


@pytest.mark.parametrize(("state", "starts"), [("Running", 0), ("Failed", 2)])
def test_workers_are_started_only_where_one_is_missing(state, starts):
    queue = FakeQueue()
    queue.states["grasps-0"] = state
    put_absent(queue, {"toy-a": None, "toy-b": None}, jobs=1)
    assert queue.starts == starts and list(queue.states) == ["grasps-0", "toy-a", "toy-b"]


def test_a_cell_whose_files_are_nowhere_is_no_cell_of_a_study():
    queue = FakeQueue()
    queue.done = {NAMES[0]: "lost"}
    fault = "in no cache and no remote; to run it again: dvc exp remove made-0000000000000000"
    assert fault in run(queue)[KEYS[0]]
    assert queue.ran == NAMES[1:]
    assert not stored(KEYS[0])
