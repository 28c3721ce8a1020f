"""What each effect of a scene costs: the time of a simulation with all effects, and without one, taken in turn."""

import time
from dataclasses import replace

import click
import numpy as np

from stages.command import OUTPUT, stage
from studies.glove_solver.scenes import FRAMES
from studies.results import write_table
from tactile_viewgcn.glove.integrator import Implicit
from tactile_viewgcn.glove.simulation import EFFECTS, MECHANICS, READING, Recipe, Simulation, recipe_of

ROUNDS, READINGS = 3, 20  # of the mechanics; of the sensors, which are quick


@stage("glove")
@click.option("--out", type=OUTPUT, required=True, help="Folder of results.csv and results.md.")
def effects(params, run, out):
    """Time a grasp of every object with every effect, without each, and without any."""
    recipe = replace(recipe_of(params.glove), sessions=1, frames=FRAMES, grasps=1, effects=frozenset(EFFECTS))
    frames = len(recipe.cells) * FRAMES
    solved = in_turn(recipe, MECHANICS, ROUNDS, solve)
    simulation = Simulation(recipe)
    mechanics = simulation.mechanics(0, FRAMES)
    states = Implicit(mechanics, 1 / recipe.rate, recipe.tolerance).run(mechanics.start(), FRAMES)
    felt = simulation.felt(mechanics, states)
    sensors = {
        wanted: Simulation(replace(recipe, effects=wanted)).sensors for wanted in without(recipe, READING).values()
    }
    read = in_turn(recipe, READING, READINGS, lambda one: sensors[one.effects].read(*felt))
    rows = []
    for part, taken in (("mechanics", solved), ("reading", read)):
        for name, seconds in taken.items():
            ratio = float(np.median(np.array(seconds) / np.array(taken["nothing"])))
            row = {"part": part, "left out": name, "seconds": float(np.median(seconds)), "against all": ratio}
            rows.append(row | {"frames a second": frames / float(np.median(seconds))})
    write_table(out, rows, f"{len(recipe.cells)} recordings of {FRAMES} frames, simulated by one process; medians.")
    run.artifact(out / "results.csv")
    print((out / "results.md").read_text(), end="")
    return {f"{row['part']}.without_{row['left out'].replace(' ', '_')}": row["against all"] for row in rows}


def without(recipe: Recipe, names: tuple[str, ...]) -> dict[str, frozenset[str]]:
    """Every effect; all but each of the names; all but all of them."""
    single = {name: recipe.effects - {name} for name in names}
    return {"nothing": recipe.effects} | single | {f"all {len(names)}": recipe.effects - set(names)}


def in_turn(recipe: Recipe, names: tuple[str, ...], rounds: int, work) -> dict[str, list[float]]:
    """Seconds that the work takes without each of the names, round by round."""
    variants = without(recipe, names)
    taken = {name: [] for name in variants}
    for _ in range(rounds):
        for name, wanted in variants.items():
            one = replace(recipe, effects=wanted)
            start = time.perf_counter()
            work(one)
            taken[name].append(time.perf_counter() - start)
    return taken


def solve(recipe: Recipe) -> None:
    """Plan the scenes and solve their mechanics."""
    mechanics = Simulation(recipe).mechanics(0, recipe.frames)
    Implicit(mechanics, 1 / recipe.rate, recipe.tolerance).run(mechanics.start(), recipe.frames)


if __name__ == "__main__":
    effects()
