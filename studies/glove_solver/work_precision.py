"""Error of the sensors' forces against run time, of several integrators, from soft contact to a stiff one."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import click
import numpy as np

from stages.command import OUTPUT, stage
from studies.glove_solver.picture import diagram
from studies.glove_solver.scenes import FRAMES, SETTINGS, scene, stiffness
from studies.results import write_table
from tactile_viewgcn.files import whole
from tactile_viewgcn.glove.comparison import GaveUp, by_scipy, explicit_euler
from tactile_viewgcn.glove.integrator import Implicit
from tactile_viewgcn.glove.simulation import Simulation, recipe_of

SEED = 3000
REFERENCE = 1e-10  # rtol of Radau
MOST, PATIENT = 10_000, 1_000_000  # evaluations of the mechanics: of a method, of the reference
TOLERANCES = (0.2, 0.05, 0.02, 0.005)
FIXED = (1, 4)  # steps a frame
EULER = (1, 8, 64, 256)
RTOLS = (1e-1, 1e-2, 1e-3, 1e-4)
SET_REFERENCE, SET_RTOLS = 1e-7, (1e-2, 1e-3, 1e-4)
TEXT = f"""Relative error of the sensors' forces against run time: one grasp of {FRAMES} frames, simulated.
The default tolerance of ours is {{tolerance:g}}.
The reference is Radau at {REFERENCE:g}, for the whole set at {SET_REFERENCE:g}.
All implicit methods are given the Gauss-Newton Hessian. Ours stops at every frame, where the scene's drive has its
kinks; SciPy's methods step over them, at most a frame at a time."""


@stage("glove")
@click.option("--out", type=OUTPUT, required=True, help="Folder of results.csv, results.md and results.png.")
def work_precision(params, run, out):
    """Time integrators on grasps from soft to stiff, and on one grasp of every object."""
    frame, rows = 1 / params.glove.frame_rate, []
    for setting in SETTINGS:
        rows += one_scene(scene(*setting, rate=params.glove.frame_rate, seed=SEED), frame, params.glove.tolerance)
    recipe = replace(recipe_of(params.glove), sessions=1, frames=FRAMES, grasps=1, seed=SEED)
    rows += whole_set(Simulation(recipe), frame, params.glove.tolerance)
    write_table(out, rows, TEXT.format(tolerance=params.glove.tolerance))
    with whole(out / "results.png") as part:
        diagram(rows).savefig(part, format="png", dpi=110)
    for name in ("results.csv", "results.png"):
        run.artifact(out / name)
    print((out / "results.md").read_text(), end="")
    ours = [row for row in rows if row["method"] == "ours" and row["setting"] == f"{params.glove.tolerance:g}"]
    return {f"error.{number}": row["error"] for number, row in enumerate(ours)}


def one_scene(simulation: Simulation, frame: float, tolerance: float) -> list[dict]:
    """Every method at every setting on one hand."""
    mechanics = simulation.mechanics(0, FRAMES)
    y = mechanics.start()
    truth, _ = by_scipy("Radau", mechanics, 0, y[0], FRAMES, frame, rtol=REFERENCE, most=PATIENT)
    felt, lambda_h = simulation.felt(mechanics, truth[None])[0], stiffness(mechanics, truth[None], frame)
    rows = []

    def add(method: str, setting: str, solve: Callable[[], tuple[np.ndarray, int]]) -> None:
        row = {"scene": f"{lambda_h:.1e}", "method": method, "setting": setting}
        rows.append(row | timed(solve, lambda states: distance(simulation.felt(mechanics, states)[0], felt)))

    for wanted in sorted({*TOLERANCES, tolerance}, reverse=True):
        add("ours", f"{wanted:g}", partial(ours, mechanics, y, frame, wanted, None))
    for steps in FIXED:
        add("ours, fixed steps", f"{steps}", partial(ours, mechanics, y, frame, tolerance, frame / steps))
    for steps in EULER:
        add("explicit Euler", f"{steps}", lambda n=steps: (explicit_euler(mechanics, y, FRAMES, frame, n), FRAMES * n))
    for method in ("RK45", "BDF", "Radau"):
        for rtol in RTOLS:
            add(method, f"{rtol:g}", partial(one_hand, method, mechanics, y, frame, rtol))
    return rows


def whole_set(simulation: Simulation, frame: float, tolerance: float) -> list[dict]:
    """Ours, all hands at once, and Radau, hand by hand, on a grasp of every object."""
    mechanics = simulation.mechanics(0, FRAMES)
    y, rows = mechanics.start(), []

    def radau(rtol: float, most: int) -> tuple[np.ndarray, int]:
        found = [by_scipy("Radau", mechanics, b, y[b], FRAMES, frame, rtol=rtol, most=most) for b in range(len(y))]
        return np.stack([states for states, _ in found]), sum(spent for _, spent in found)

    felt = simulation.felt(mechanics, radau(SET_REFERENCE, PATIENT)[0])[0]
    name = f"{len(y)} recordings"
    for wanted in sorted({*TOLERANCES, tolerance}, reverse=True):
        solve = partial(ours, mechanics, y, frame, wanted, None)
        found = timed(solve, lambda states: distance(simulation.felt(mechanics, states)[0], felt))
        rows.append({"scene": name, "method": "ours", "setting": f"{wanted:g}"} | found)
    for rtol in SET_RTOLS:
        found = timed(
            partial(radau, rtol, PATIENT), lambda states: distance(simulation.felt(mechanics, states)[0], felt)
        )
        rows.append({"scene": name, "method": "Radau", "setting": f"{rtol:g}"} | found)
    return rows


def ours(mechanics, y: np.ndarray, frame: float, tolerance: float, step: float | None) -> tuple[np.ndarray, int]:
    solver = Implicit(mechanics, frame, tolerance, step)
    return solver.run(y, FRAMES), solver.work.evaluations


def one_hand(method: str, mechanics, y: np.ndarray, frame: float, rtol: float) -> tuple[np.ndarray, int]:
    states, spent = by_scipy(method, mechanics, 0, y[0], FRAMES, frame, rtol=rtol, most=MOST)
    return states[None], spent


def timed(solve: Callable[[], tuple[np.ndarray, int]], error: Callable[[np.ndarray], float]) -> dict:
    """Error, seconds and evaluations of a method; NaN and why where it gave up."""
    start = time.perf_counter()
    try:
        states, spent = solve()
    except GaveUp as reason:
        return {"error": np.nan, "seconds": time.perf_counter() - start, "evaluations": np.nan, "remark": str(reason)}
    seconds = time.perf_counter() - start
    return {"error": error(states), "seconds": seconds, "evaluations": spent, "remark": ""}


def distance(felt: np.ndarray, truth: np.ndarray) -> float:
    """Relative error: the norm over frames and sensors, over that of the truth; the median of the recordings."""
    wrong = np.linalg.norm((felt - truth).reshape(len(truth), -1), axis=1)
    size = np.linalg.norm(truth.reshape(len(truth), -1), axis=1)
    return float(np.median(wrong[size > 0] / size[size > 0]))


if __name__ == "__main__":
    work_precision()
