"""Run the cells of a study that have not been run, and say how far it is."""

import math
import sys
import time
from collections.abc import Callable
from itertools import islice

from tqdm import tqdm

from studies.cells import experiment_of, store, stored
from studies.dvc_queue import DvcQueue
from studies.grid import Cell
from tactile_viewgcn.errors import UserError

POLL, ORPHANS = 2.0, 30.0  # seconds between looks at the queue, and at its workers
WIDTH = 79


def progress(name: str, total: int, before: int, done: int, failed: int, running: int, seconds: float) -> str:
    """A line on how far a study is: its cells in total, done `before` and in these seconds, failed and running."""
    ended, failures = before + done + failed, f", {failed} failed" if failed else ""
    counts = f"{before + done} done, {running} running, {total - ended - running} waiting{failures}"
    form = "{elapsed} gone, {remaining} left"
    clock = tqdm.format_meter(ended, total, seconds, initial=before, bar_format=form)
    return f"{name}: {counts} | {clock}"[:WIDTH]


def show(line: str, text: str = "") -> None:
    """Print a text, which stays, and the line: on a terminal it is rewritten, elsewhere it follows each text."""
    if sys.stdout.isatty():
        stays = f"{text:{WIDTH}}\n" if text else ""
        print(f"\r{stays}{line:{WIDTH}}", end="", flush=True)
    elif text:
        print(text, line, sep="\n", flush=True)


def run_cells(
    name: str, cells: dict[str, Cell], queue: DvcQueue, *, jobs: int = 1, wait: Callable[[float], None] = time.sleep
) -> dict[str, str]:
    """Run every cell that is not stored; what waits or runs since an earlier run is kept, what failed is tried again.

    Args:
        name: of the study; cells: by their keys.
        queue: where they run.
        wait: called between two looks at the queue.

    Returns:
        What went wrong, by the key of the cell.
    """
    missing = {experiment_of(name, key): key for key in cells if not stored(key)}
    before, begin, faults, begun = len(cells) - len(missing), time.monotonic(), {}, set()
    texts = {key: f"{number} of {len(cells)}: {cell}" for number, (key, cell) in enumerate(cells.items(), start=1)}

    def line(running: int) -> str:
        done = len(cells) - before - len(missing) - len(faults)
        return progress(name, len(cells), before, done, len(faults), running, time.monotonic() - begin)

    status, finished = queue.status(), queue.finished()
    ended = [experiment for experiment in missing if status.get(experiment) in ("Failed", "Success")]
    queue.remove(experiment for experiment in ended if experiment not in finished)
    checked, lost = -math.inf, set()
    while missing:
        status, finished = queue.status(), queue.finished()
        running = sum(status.get(experiment) == "Running" for experiment in missing)
        for experiment in [experiment for experiment in missing if status.get(experiment) != "Running"]:
            key, fault = missing[experiment], ""
            if experiment in finished:
                try:
                    store(key, queue.results(finished[experiment]))
                except UserError as error:
                    fault = str(error)
                except FileNotFoundError:
                    if experiment in lost:
                        raise
                    if experiment in status:
                        lost.add(experiment)  # from DVC's cache: it runs once more
                        queue.forget(experiment)
                        continue
                    fault = f"its files are in no cache and no remote; to run it again: dvc exp remove {experiment}"
            elif status.get(experiment) == "Failed":
                fault = queue.last_line(experiment)
            else:
                continue
            del missing[experiment]
            if fault:
                faults[key] = fault
                show(line(running), f"{texts[key]} failed: {fault}")
            elif experiment not in begun:
                show(line(running), texts[key])
        if missing and time.monotonic() - checked > ORPHANS:
            queue.remove_orphans(missing)
            _put(queue, {experiment: cells[key] for experiment, key in missing.items()}, jobs)
            checked = time.monotonic()
        for experiment, key in missing.items():
            if status.get(experiment) == "Running" and experiment not in begun:
                begun.add(experiment)
                show(line(running), f"{texts[key]} ...")
        show(line(running))
        if missing:
            wait(POLL)
    print(end="\n" * sys.stdout.isatty(), flush=True)
    return faults


def _put(queue: DvcQueue, cells: dict[str, Cell], jobs: int) -> None:
    """Queue the cells that the queue does not have, and see to it that workers run: from the first cell on."""
    status, finished = queue.status(), queue.finished()
    absent = {name: cell for name, cell in cells.items() if name not in status and name not in finished}
    first = dict(islice(absent.items(), 1))
    if first:
        queue.put(first)
        queue.start(jobs)
    if others := {name: cell for name, cell in absent.items() if name not in first}:
        queue.put(others)
    if others or ("Queued" in status.values() and sum(each == "Running" for each in status.values()) < jobs):
        queue.start(jobs)
