"""Run the missing cells of a study, in threads here or on the workers of a Dask scheduler."""

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from secrets import token_hex

from tqdm import tqdm

from studies.cells import store, stored
from studies.experiment import end_cells, git, run_cell, tie
from studies.grid import Cell
from tactile_viewgcn.messages import UserError


def run_cells(name: str, cells: dict[str, Cell], *, jobs: int = 1, scheduler: str | None = None) -> dict[str, str]:
    """Run every cell that is not stored, and store its results. An interrupt ends the running cells.

    Args:
        name: name of the study.
        cells: the cells, by their keys.
        jobs: number of cells at once without a scheduler.
        scheduler: address of Dask's scheduler.

    Returns:
        The faults of cells that failed, by their keys.
    """
    missing, faults, run = [key for key in cells if not stored(key)], {}, token_hex(4)
    commit = git("rev-parse", "HEAD").strip() if scheduler else ""
    with (
        tqdm(total=len(cells), initial=len(cells) - len(missing), desc=name, unit="cell", disable=None) as bar,
        workers(run, jobs, scheduler) as pool,
    ):
        futures = {pool.submit(run_cell, f"{name}-{key}", key, cells[key], run, commit): key for key in missing}
        for number, future in enumerate(as_completed(futures), start=len(cells) - len(missing) + 1):
            key, outcome = futures[future], "done"
            try:
                store(key, future.result())
            except Exception as error:
                if not (scheduler or isinstance(error, UserError)):
                    raise  # a fault of ours keeps its traceback
                remedy = "" if isinstance(error, UserError) else f" ({type(error).__name__}; see docs/cluster.md)"
                faults[key] = " ".join(f"{error}{remedy}".split())
                outcome = f"failed: {faults[key]}"
            bar.update()
            bar.write(f"{number} of {len(cells)}: {cells[key]} {outcome}")
    return faults


@contextmanager
def workers(run: str, jobs: int, scheduler: str | None) -> Iterator[Executor]:
    """An executor for the cells, which ends the running ones if the block ends with an exception.

    It is Dask's own executor, since joblib's backend waits for ever for a cell whose workers have all died.

    Raises:
        UserError: Dask is not installed, or there is no such scheduler.
    """
    if not scheduler:
        tie(run)  # before there are threads
        with ThreadPoolExecutor(jobs) as pool:
            try:
                yield pool
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                end_cells(run)
                raise
        return
    try:
        from distributed import Client

        client = Client(scheduler)
    except ImportError:
        raise UserError("--scheduler needs Dask: pip install -e '.[cluster]'") from None
    except (OSError, ValueError) as error:
        raise UserError(f"--scheduler is {scheduler}: {error}; expected what `dask scheduler` prints") from None
    with client:
        if not client.ncores():
            tqdm.write("no worker yet: see docs/cluster.md")
        try:
            yield (pool := client.get_executor(pure=False))
        except BaseException:
            pool.shutdown(wait=False)
            client.run(end_cells, run, on_error="ignore")
            raise
