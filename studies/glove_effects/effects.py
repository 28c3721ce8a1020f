"""What each effect of a scene costs: the time of a simulation with it and without, taken in turn."""

import time
from dataclasses import replace

import click
import numpy as np

from stages.command import OUTPUT, stage
from studies.glove_solver.scenes import FRAMES
from studies.results import write_table
from tactile_viewgcn.glove.integrator import Implicit
from tactile_viewgcn.glove.simulation import EFFECTS, Recipe, Simulation, recipe_of

ROUNDS = 3


@stage("glove")
@click.option("--out", type=OUTPUT, required=True, help="Folder of results.csv and results.md.")
def effects(params, run, out):
    """Time a grasp of every object with every effect, without each, and with none."""
    recipe = replace(recipe_of(params.glove), sessions=1, frames=FRAMES, grasps=1, effects=frozenset(EFFECTS))
    variants = {"all": recipe.effects, "none": frozenset()}
    variants |= {f"all but {name}": recipe.effects - {name} for name in EFFECTS}
    taken = {name: [] for name in variants}
    for _ in range(ROUNDS):
        for name, wanted in variants.items():
            taken[name].append(seconds(replace(recipe, effects=wanted)))
    rows = []
    for name, rounds in taken.items():
        solving, reading = np.median(rounds, axis=0)
        frames = len(recipe.cells) * FRAMES
        rows.append({
            "effects": name, "mechanics, s": float(solving), "reading, s": float(reading),
            "frames a second": frames / float(solving + reading),
            "time against all": float(np.median(np.sum(rounds, axis=1) / np.sum(taken["all"], axis=1))),
        })  # fmt: skip
    write_table(out, rows, f"{len(recipe.cells)} recordings of {FRAMES} frames, one process, medians of {ROUNDS}.")
    run.artifact(out / "results.csv")
    print((out / "results.md").read_text(), end="")
    return {"frames_per_second": rows[0]["frames a second"], "frames_per_second.none": rows[1]["frames a second"]}


def seconds(recipe: Recipe) -> tuple[float, float]:
    """Of the mechanics, and of reading the sensors."""
    start = time.perf_counter()
    simulation = Simulation(recipe)
    mechanics = simulation.mechanics(0, recipe.frames)
    states = Implicit(mechanics, 1 / recipe.rate, recipe.tolerance).run(mechanics.start(), recipe.frames)
    felt = simulation.felt(mechanics, states)
    middle = time.perf_counter()
    simulation.sensors.read(*felt)
    return middle - start, time.perf_counter() - middle


if __name__ == "__main__":
    effects()
