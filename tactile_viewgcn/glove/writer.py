"""Writes the recordings of a recipe as HDF5 files. Everything in them is simulated."""

from collections import Counter
from contextlib import ExitStack
from multiprocessing import get_context
from pathlib import Path

import h5py
import numpy as np
from tqdm import tqdm

from tactile_viewgcn.files import atomic_folder
from tactile_viewgcn.glove.recipe import VERSION, Cell, Recipe
from tactile_viewgcn.glove.simulation import BLOCK, Simulation

MIN_RECORDINGS_PER_WORKER = 20  # with fewer, starting a process takes longer than it saves


def simulate(recipe: Recipe, folder: str | Path, *, workers: int = 1) -> Counter[str]:
    """Write a recipe's recordings to `folder`/SESSION/NUMBER-OBJECT.h5, all of them or none.

    The recordings do not depend on the number of worker
    processes. Memory holds a block of pressures and about 300 bytes a frame of every recording.

    Returns:
        The cost, see `Simulation.statistics`.

    Raises:
        UserError: grasps too short for their phases, or an object that starts inside the palm.
    """
    workers = max(1, min(workers, len(recipe.cells) // MIN_RECORDINGS_PER_WORKER))
    shares = [recipe.cells[worker::workers] for worker in range(workers)]
    with atomic_folder(folder) as part:
        for session in range(recipe.sessions):
            (part / f"{session:03d}").mkdir()
        jobs = [(recipe, share, part, worker) for worker, share in enumerate(shares)]
        if workers == 1:
            return _write(jobs[0])
        with get_context("spawn").Pool(workers) as pool:  # its processes end with the block, also after an error
            costs = list(pool.imap_unordered(_write, jobs))
            pool.close()
            pool.join()  # left to themselves, so that none is ended while it holds a lock: Python would warn
    return sum(costs, Counter())


def _write(job: tuple[Recipe, list[Cell], Path, int]) -> Counter[str]:
    """Simulate the recordings of one process into a folder of sessions; the first worker shows the progress."""
    recipe, cells, folder, worker = job
    simulation, start = Simulation(recipe, cells), 0
    bar = tqdm(total=recipe.frames, desc="simulate", unit="frame", disable=None if worker == 0 else True)
    with ExitStack() as stack, bar:
        files = [stack.enter_context(_create_file(folder, simulation, b)) for b in range(len(cells))]
        for block in simulation.blocks():
            for file, counts in zip(files, block, strict=True):
                file["pressure"][start : start + len(counts)] = counts
            start += block.shape[1]
            bar.update(block.shape[1])
    return simulation.statistics


def _create_file(folder: Path, simulation: Simulation, b: int) -> h5py.File:
    """File of recording b with everything in it but the counts."""
    recipe, (session, number) = simulation.recipe, simulation.cells[b]
    grasp_object = recipe.objects[number]
    name = f"{number:03d}-{grasp_object.name}"
    file = h5py.File(folder / f"{session:03d}" / f"{name}.h5", "w")
    file.create_dataset(
        "pressure", (recipe.frames, 32, 32), np.int16, chunks=(min(BLOCK, recipe.frames), 32, 32),
        compression="gzip", compression_opts=1, shuffle=True,
    )  # fmt: skip
    file["time"] = np.arange(recipe.frames) / recipe.rate
    file["valid"] = simulation.plan.steady
    file["grasp"] = simulation.plan.grasp.astype(np.int16)
    file.attrs.update({
        "object": grasp_object.name, "session": f"{session:03d}", "weight": float(grasp_object.weight),
        "split": recipe.side(session),
        "simulated": f"virtual glove, version {VERSION}, seed {recipe.seed}",
        "effects": " ".join(sorted(recipe.effects)), "layer": str(recipe.layer), "tolerance": recipe.tolerance,
    })  # fmt: skip
    return file
