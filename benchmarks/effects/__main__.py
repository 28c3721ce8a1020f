"""Cost of each effect of a scene: seconds of a simulation with all effects, and without one, timed in turn."""

from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.command import Result, benchmark, interleaved, median_ratio
from benchmarks.solver.scenes import FRAMES
from tactile_viewgcn.glove.integrator import ImplicitIntegrator
from tactile_viewgcn.glove.objects import select_objects
from tactile_viewgcn.glove.recipe import EFFECTS, MECHANICS, READING, Recipe, recipe_from_params
from tactile_viewgcn.glove.simulation import Simulation
from tactile_viewgcn.params import Params

ROUNDS = 3


@benchmark
def effects(params: Params, quick: bool) -> Result:
    """Time a grasp of every object with every effect, without each, and without any.

    Takes about four minutes; --quick is one round with a ball at a coarse tolerance.
    """
    recipe = replace(recipe_from_params(params.glove), sessions=1, frames=FRAMES, grasps=1, effects=frozenset(EFFECTS))
    if quick:
        recipe = replace(recipe, objects=select_objects(["ball"])[1:], tolerance=0.2)
    simulation, mechanics, states = solve(recipe)
    inputs = simulation.sensor_inputs(mechanics, states)
    rounds = 1 if quick else ROUNDS
    mechanics_work = {name: partial(solve, variant) for name, variant in without_each(recipe, MECHANICS).items()}
    sensors = {name: Simulation(variant).sensors for name, variant in without_each(recipe, READING).items()}
    reading_work = {name: partial(each.read, *inputs) for name, each in sensors.items()}
    frames = len(recipe.cells) * recipe.frames
    rows = rows_of("mechanics", interleaved(mechanics_work, rounds), frames)
    rows += rows_of("reading", interleaved(reading_work, rounds), frames)
    return f"{len(recipe.cells)} recordings of {FRAMES} frames, simulated by one process; medians.", rows, None


def solve(recipe: Recipe):
    """The simulation, its mechanics, and the states of all frames: scenes are planned and their mechanics solved."""
    simulation = Simulation(recipe)
    mechanics = simulation.mechanics(0, recipe.frames)
    integrator = ImplicitIntegrator(mechanics, 1 / recipe.rate, recipe.tolerance)
    return simulation, mechanics, integrator.run(mechanics.initial_state(), recipe.frames)


def without_each(recipe: Recipe, names: tuple[str, ...]) -> dict[str, Recipe]:
    """The recipe with every effect; without each of the names; without all of them."""
    left_out = {"nothing": ()} | {name: (name,) for name in names} | {f"all {len(names)}": names}
    return {name: replace(recipe, effects=recipe.effects - set(gone)) for name, gone in left_out.items()}


def rows_of(part: str, seconds: dict[str, np.ndarray], frames: int) -> list[dict]:
    """A row for each variant; `against all` is the median over rounds of the ratio to the time with every effect."""
    rows = []
    for name, times in seconds.items():
        median, ratio = float(np.median(times)), median_ratio(times, seconds["nothing"])
        row = {"part": part, "left out": name, "seconds": median, "against all": ratio}
        rows.append(row | {"frames a second": frames / median})
    return rows


if __name__ == "__main__":
    effects()
