"""Error of the sensors' forces against run time, for several integrators, from soft to stiff contact."""

import time
from dataclasses import replace

import click
import numpy as np
from matplotlib.figure import Figure

from benchmarks.command import Result, benchmark
from benchmarks.solver.other_integrators import (
    IntegrationFailed,
    explicit_euler,
    integrate_with_scipy,
)
from benchmarks.solver.scenes import FRAMES, SETTINGS, ball_grasp, stiffness
from tactile_viewgcn.glove.contact import Mechanics
from tactile_viewgcn.glove.integrator import ImplicitIntegrator
from tactile_viewgcn.glove.objects import select_objects
from tactile_viewgcn.glove.simulation import RATE, TOLERANCE, Simulation, recipe_from_params
from tactile_viewgcn.params import Params

SEED = 3000
TOLERANCES, RTOLS = (0.2, 0.05, 0.02, 0.005), (1e-1, 1e-2, 1e-3, 1e-4)
STEPS = {"ours, fixed steps": (1, 4), "explicit Euler": (1, 8, 64, 256)}  # a frame
BALL_RTOL, OBJECTS_RTOL, QUICK_RTOL = 1e-10, 1e-7, 1e-5  # of the reference, Radau
# of a method on a ball; of references, and on objects
MAX_EVALUATIONS, NO_LIMIT = 10_000, 1_000_000
STYLES = {
    "ours": "o-",
    "ours, fixed steps": "o:",
    "explicit Euler": "v--",
    "RK45": "^--",
    "BDF": "s-",
    "Radau": "D-",
}
# errors at the axis' ends, and where a failed run is drawn
LOWEST, HIGHEST, FAILED = 1e-6, 1e2, 60.0
TEXT = f"""Relative error of the sensors' forces against processor time: one grasp of {FRAMES} frames, simulated.
The default tolerance of ours is {{tolerance:g}}.
The reference is Radau at {{ball_rtol:g}}, for the whole set at {{objects_rtol:g}}.
All implicit methods are given the Gauss-Newton Hessian. Ours stops at every frame, where the scene's drive has its
kinks; SciPy's methods step over them, at most a frame at a time."""


@benchmark
def solver(params: Params, quick: bool) -> Result:
    """Time integrators on one grasp of a ball, from soft to stiff, and of every object.

    Takes about 50 minutes of one core (AMD EPYC with AVX2); --quick is a soft ball and a coin, two
    settings of each method, and a coarser reference.
    """
    recipe = replace(
        recipe_from_params(params.glove), sessions=1, frames=FRAMES, grasps=1, seed=SEED
    )
    settings, ball_rtol, objects_rtol = SETTINGS, BALL_RTOL, OBJECTS_RTOL
    ours = {"ours": sorted({*TOLERANCES, TOLERANCE}, reverse=True)}
    on_balls = ours | STEPS | dict.fromkeys(("RK45", "BDF", "Radau"), RTOLS)
    on_objects = ours | {"Radau": RTOLS[1:]}
    if quick:
        settings, ball_rtol, objects_rtol = SETTINGS[1:2], QUICK_RTOL, QUICK_RTOL
        recipe = replace(recipe, objects=select_objects(["coin"]))
        on_balls, on_objects = (
            {name: values[:2] for name, values in each.items()} for each in (on_balls, on_objects)
        )
    rows = []
    for setting in settings:
        grasp = ball_grasp(*setting, seed=SEED)
        rows += measure(grasp, on_balls, ball_rtol, MAX_EVALUATIONS)
    rows += measure(Simulation(recipe), on_objects, objects_rtol, NO_LIMIT)
    text = TEXT.format(tolerance=TOLERANCE, ball_rtol=ball_rtol, objects_rtol=objects_rtol)
    return text, rows, diagram(rows)


def measure(
    simulation: Simulation, methods: dict, reference_rtol: float, max_evaluations: int
) -> list[dict]:
    """A row for each method and setting: error, seconds, evaluations, and why it failed; prints each.

    The scene is named by its stiffness lambda h, or where there are several hands by their number.
    """
    mechanics, frame = simulation.mechanics(0, FRAMES), 1 / RATE
    exact = solve("Radau", reference_rtol, mechanics, NO_LIMIT)[0]
    exact_pressure = simulation.sensor_inputs(mechanics, exact)[0]
    scene = (
        f"{len(exact)} recordings"
        if len(exact) > 1
        else f"{stiffness(mechanics, exact, frame):.1e}"
    )
    rows = []
    for method, setting in [
        (method, setting) for method, settings in methods.items() for setting in settings
    ]:
        error, evaluations, remark, begin = np.nan, np.nan, "", time.process_time()
        try:
            states, evaluations = solve(method, setting, mechanics, max_evaluations)
        except IntegrationFailed as reason:
            remark = str(reason)
        seconds = time.process_time() - begin  # of the processor: other programs do not count
        if not remark:
            error = relative_error(simulation.sensor_inputs(mechanics, states)[0], exact_pressure)
        row = {
            "scene": scene,
            "method": method,
            "setting": f"{setting:g}",
            "error": error,
            "seconds": seconds,
        }
        rows.append(row | {"evaluations": evaluations, "remark": remark})
        outcome = remark or f"error {error:.2g} in {seconds:.3g} s"
        click.echo(f"{scene:13}  {method:17} {setting:7g}  {outcome}")
    return rows


def solve(
    method: str, setting: float, mechanics: Mechanics, max_evaluations: int
) -> tuple[np.ndarray, int]:
    """States (B, FRAMES, n) and number of evaluations.

    The setting is the tolerance of ours and of SciPy's methods, else the number of steps in a
    frame.

    Raises:
        IntegrationFailed: as in `other_integrators`; SciPy's methods solve hand by hand, each
            within the limit.
    """
    y, frame = mechanics.initial_state(), 1 / RATE
    if method == "explicit Euler":
        return explicit_euler(mechanics, y, FRAMES, frame, setting), FRAMES * setting
    if method.startswith("ours"):
        tolerance, step = (setting, None) if method == "ours" else (TOLERANCE, frame / setting)
        integrator = ImplicitIntegrator(mechanics, frame, tolerance, step)
        return integrator.run(y, FRAMES), integrator.statistics["evaluations"]
    limits = {"rtol": setting, "max_evaluations": max_evaluations}
    hands = [
        integrate_with_scipy(method, mechanics, b, y[b], FRAMES, frame, **limits)
        for b in range(len(y))
    ]
    return np.stack([states for states, _ in hands]), sum(evaluations for _, evaluations in hands)


def relative_error(pressure: np.ndarray, exact: np.ndarray) -> float:
    """Norm of the difference over frames and sensors, over that of `exact` (B, T, S); median of the recordings."""
    difference = np.linalg.norm((pressure - exact).reshape(len(exact), -1), axis=1)
    size = np.linalg.norm(exact.reshape(len(exact), -1), axis=1)
    return float(np.median(difference[size > 0] / size[size > 0]))


def diagram(rows: list[dict]) -> Figure:
    """Error against seconds: a panel for each scene, a line for each method; crosses at the top are failed runs."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    columns, lines = min(3, len(scenes)), -(-len(scenes) // 3)
    figure = Figure(figsize=(5 * columns, 4.3 * lines), dpi=110, layout="constrained")
    for number, scene in enumerate(scenes, 1):
        panel = figure.add_subplot(
            lines, columns, number, xscale="log", yscale="log", ylim=(LOWEST, HIGHEST)
        )
        panel.set(xlabel="seconds", ylabel="relative error")
        panel.set_title(
            f"{scene}, one grasp each" if "record" in scene else f"lambda h = {float(scene):.0e}"
        )
        panel.axhline(1e-2, color="0.8", lw=1)
        for color, (method, style) in enumerate(STYLES.items()):
            runs = [row for row in rows if (row["scene"], row["method"]) == (scene, method)]
            if not runs:
                continue
            seconds, error = np.array([(row["seconds"], row["error"]) for row in runs]).T
            failed = np.isnan(error)
            good, crosses = np.clip(error[~failed], LOWEST, HIGHEST), np.full(failed.sum(), FAILED)
            labels = (None, f"{method}: failed") if failed.all() else (method, None)
            panel.plot(seconds[~failed], good, style, color=f"C{color}", label=labels[0])
            panel.plot(seconds[failed], crosses, "x", color=f"C{color}", label=labels[1])
        panel.legend(fontsize=7)
    figure.suptitle(
        "Error of the sensors' forces against run time\nx: diverged or gave up; grey line: 1 %"
    )
    return figure


if __name__ == "__main__":
    solver()
