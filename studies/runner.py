"""Run the cells of a study that have not been run, and say how far it is."""

import time
from collections.abc import Callable

from tqdm import tqdm

from studies.cells import store, stored
from studies.grid import Cell
from studies.queue import Queue
from tactile_viewgcn.errors import UserError

POLL = 30.0  # seconds between looks at the queue, each of which takes DVC a second or two


def run_cells(
    name: str, cells: dict[str, Cell], queue: Queue, *, jobs: int = 1, wait: Callable[[float], None] = time.sleep
) -> dict[str, str]:
    """Run every cell that is not stored; what waits or runs since an earlier run is kept, what failed is tried again.

    Args:
        name: of the study; cells: by their keys; wait: called between two looks at the queue.

    Returns:
        What went wrong, by the key of the cell.
    """
    texts = {key: f"{number} of {len(cells)}: {cell}" for number, (key, cell) in enumerate(cells.items(), start=1)}
    missing = {f"{name}-{key}": key for key in cells if not stored(key)}  # by experiments, the same in every clone
    faults: dict[str, str] = {}
    running: set[str] = set()
    queue.remove(each for each, (state, _) in queue.tasks().items() if each in missing and state == "Failed")
    with tqdm(total=len(cells), initial=len(cells) - len(missing), desc=name, unit="cell", disable=None) as bar:
        while missing:
            tasks, finished = queue.tasks(), queue.finished()
            for experiment, key in list(missing.items()):
                state = tasks.get(experiment, ("",))[0]
                if state == "Running" and experiment not in running:
                    running.add(experiment)
                    bar.write(f"{texts[key]} ...")
                if experiment in finished:
                    fault = collect(queue, key, experiment, finished[experiment])
                elif state == "Failed":
                    fault = queue.fault_of(experiment)
                else:
                    continue
                running.discard(experiment)
                del missing[experiment]
                bar.update()
                bar.write(f"{texts[key]} {f'failed: {fault}' if fault else 'done'}")
                if fault:
                    faults[key] = fault
            bar.set_postfix(running=len(running), failed=len(faults))
            if missing:
                queue.remove_killed(missing)
                put_absent(queue, {experiment: cells[key] for experiment, key in missing.items()}, jobs)
                wait(POLL)
    return faults


def collect(queue: Queue, key: str, experiment: str, commit: str) -> str:
    """Store the results of a finished experiment; what went wrong, or nothing."""
    try:
        store(key, queue.results(commit))
    except UserError as error:
        return str(error)
    except FileNotFoundError:
        return f"its files are in no cache and no remote; to run it again: dvc exp remove {experiment}"
    return ""


def put_absent(queue: Queue, cells: dict[str, Cell], jobs: int) -> None:
    """Queue the cells, by their experiments, that the queue does not have, and see to it that workers run."""
    known = queue.tasks().keys() | queue.finished().keys()
    absent = [name for name in cells if name not in known]
    for number, name in enumerate(absent):
        queue.put(name, cells[name])
        if number == 0:  # the first cell runs while the others are queued
            start_workers(queue, jobs)
    if len(absent) != 1:
        start_workers(queue, jobs)


def start_workers(queue: Queue, jobs: int) -> None:
    """Start workers where a task waits and fewer than `jobs` run: DVC overlooks busy workers, and would start more."""
    states = [state for state, _ in queue.tasks().values()]
    if "Queued" in states and states.count("Running") < jobs:
        queue.start(jobs)
