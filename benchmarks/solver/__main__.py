"""Error of the sensors' forces against run time, for several integrators and stiffnesses."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import click
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.command import Result, Row, benchmark
from benchmarks.solver.other_integrators import (
    IntegrationFailed,
    explicit_euler,
    integrate_with_scipy,
)
from benchmarks.solver.scenes import FRAMES, SETTINGS, ball_grasp, stiffness
from tactile_viewgcn.glove.integrator import ImplicitIntegrator
from tactile_viewgcn.glove.mechanics import Mechanics
from tactile_viewgcn.glove.objects import select_objects
from tactile_viewgcn.glove.simulation import RATE, TOLERANCE, Simulation, recipe_from_params
from tactile_viewgcn.params import Params

Methods = Mapping[str, Sequence[float]]  # settings of each method, see `solve`

SEED = 3000
TOLERANCES = (0.2, 0.05, 0.02, 0.005)  # tolerances of our integrator
RTOLS = (1e-1, 1e-2, 1e-3, 1e-4)  # relative tolerances of SciPy's methods
STEPS = {"ours, fixed steps": (1, 4), "explicit Euler": (1, 8, 64, 256)}  # steps in a frame
# relative tolerances of the reference, Radau
BALL_RTOL = 1e-10
OBJECTS_RTOL = 1e-7
QUICK_RTOL = 1e-5
MAX_EVALUATIONS = 10_000  # of a method on the grasp of a ball
NO_LIMIT = 1_000_000  # evaluations of a reference, and of a method on the grasps of all objects
STYLES = {
    "ours": "o-",
    "ours, fixed steps": "o:",
    "explicit Euler": "v--",
    "RK45": "^--",
    "BDF": "s-",
    "Radau": "D-",
}
# errors at the ends of the axis
LOWEST = 1e-6
HIGHEST = 1e2
FAILED = 60.0  # error at which a failed run is drawn
TEXT = f"""Relative error of the sensors' forces against CPU time, for one simulated grasp of
{FRAMES} frames.
The default tolerance of our integrator is {{tolerance:g}}.
The reference is Radau with a relative tolerance of {{ball_rtol:g}}, and of {{objects_rtol:g}} for
the whole set.
All implicit methods get the Gauss-Newton Hessian. The scene's drive has a kink at every frame. Our
integrator stops there; SciPy's methods step over kinks, at most a frame at a time."""


@benchmark
def solver(params: Params, quick: bool) -> Result:
    """Time integrators on one grasp of a ball, from soft to stiff, and of every object.

    It takes about 50 minutes of one core (AMD EPYC with AVX2). With --quick there are a soft ball
    and a coin, two settings of each method, and a coarser reference.
    """
    recipe = replace(
        recipe_from_params(params.glove), sessions=1, frames=FRAMES, grasps=1, seed=SEED
    )
    settings: Sequence[tuple[float, float, float, float]] = SETTINGS
    ball_rtol = BALL_RTOL
    objects_rtol = OBJECTS_RTOL
    ours: dict[str, Sequence[float]] = {"ours": sorted({*TOLERANCES, TOLERANCE}, reverse=True)}
    on_balls = {**ours, **STEPS, "RK45": RTOLS, "BDF": RTOLS, "Radau": RTOLS}
    on_objects = {**ours, "Radau": RTOLS[1:]}
    if quick:
        settings = SETTINGS[1:2]
        ball_rtol = QUICK_RTOL
        objects_rtol = QUICK_RTOL
        recipe = replace(recipe, objects=select_objects(["coin"]))
        on_balls = {method: values[:2] for method, values in on_balls.items()}
        on_objects = {method: values[:2] for method, values in on_objects.items()}
    rows = []
    for setting in settings:
        grasp = ball_grasp(*setting, seed=SEED)
        rows += measure(grasp, on_balls, ball_rtol, MAX_EVALUATIONS)
    rows += measure(Simulation(recipe), on_objects, objects_rtol, NO_LIMIT)
    text = TEXT.format(tolerance=TOLERANCE, ball_rtol=ball_rtol, objects_rtol=objects_rtol)
    return text, rows, diagram(rows)


def measure(
    simulation: Simulation, methods: Methods, reference_rtol: float, max_evaluations: int
) -> list[Row]:
    """Return a row for each method and setting: error, seconds, evaluations, and why it failed.

    A scene of one hand is named by its stiffness lambda h, and a scene of several hands by their
    number. Each row is also printed.

    Args:
        simulation: one grasp of one or several hands.
        methods: settings of each method.
        reference_rtol: relative tolerance of the reference.
        max_evaluations: largest number of evaluations of a method.
    """
    mechanics = simulation.mechanics(0, FRAMES)
    exact = solve("Radau", reference_rtol, mechanics, NO_LIMIT)[0]
    exact_pressure = simulation.sensor_inputs(mechanics, exact)[0]
    scene = f"{len(exact)} recordings"
    if len(exact) == 1:
        scene = f"{stiffness(mechanics, exact, 1 / RATE):.1e}"
    rows = []
    for method, settings in methods.items():
        for setting in settings:
            error = np.nan
            evaluations: float = np.nan
            remark = ""
            begin = time.process_time()
            try:
                states, evaluations = solve(method, setting, mechanics, max_evaluations)
            except IntegrationFailed as reason:
                remark = str(reason)
            seconds = time.process_time() - begin  # CPU time, so that other programs do not count
            outcome = remark
            if not remark:
                pressure = simulation.sensor_inputs(mechanics, states)[0]
                error = relative_error(pressure, exact_pressure)
                outcome = f"error {error:.2g} in {seconds:.3g} s"
            row: Row = {"scene": scene, "method": method, "setting": f"{setting:g}"}
            row |= {"error": error, "seconds": seconds}
            row |= {"evaluations": evaluations, "remark": remark}
            rows.append(row)
            click.echo(f"{scene:13}  {method:17} {setting:7g}  {outcome}")
    return rows


def solve(
    method: str, setting: float, mechanics: Mechanics, max_evaluations: int
) -> tuple[np.ndarray, int]:
    """Return states (B, FRAMES, n) and number of evaluations.

    Args:
        method: one of `STYLES`.
        setting: tolerance of our integrator and of SciPy's methods. For methods with fixed steps it
            is the number of steps in a frame.
        mechanics: the equation of B hands.
        max_evaluations: limit for each hand, since SciPy's methods solve hand by hand.

    Raises:
        IntegrationFailed: the method diverged, failed, or used up its evaluations.
    """
    y = mechanics.initial_state()
    frame = 1 / RATE
    if method == "explicit Euler":
        steps = int(setting)
        return explicit_euler(mechanics, y, FRAMES, frame, steps), FRAMES * steps
    if method == "ours":
        integrator = ImplicitIntegrator(mechanics, frame, setting, None)
        return integrator.run(y, FRAMES), integrator.statistics["evaluations"]
    if method == "ours, fixed steps":
        integrator = ImplicitIntegrator(mechanics, frame, TOLERANCE, frame / setting)
        return integrator.run(y, FRAMES), integrator.statistics["evaluations"]
    hands = []
    evaluations = 0
    for row in range(len(y)):
        states, count = integrate_with_scipy(
            method,
            mechanics,
            row,
            y[row],
            FRAMES,
            frame,
            rtol=setting,
            max_evaluations=max_evaluations,
        )
        hands.append(states)
        evaluations += count
    return np.stack(hands), evaluations


def relative_error(pressure: np.ndarray, exact: np.ndarray) -> float:
    """Return the norm of the difference over the norm of the exact pressure.

    Args:
        pressure: (B, T, S) pressure in recordings, frames and sensors.
        exact: (B, T, S) exact pressure.

    Returns:
        The median over the recordings.
    """
    difference = np.linalg.norm((pressure - exact).reshape(len(exact), -1), axis=1)
    size = np.linalg.norm(exact.reshape(len(exact), -1), axis=1)
    return float(np.median(difference[size > 0] / size[size > 0]))


def diagram(rows: list[Row]) -> Figure:
    """Return a picture of error against seconds: a panel for each scene, a line for each method.

    A cross at the top is a run that failed.

    Args:
        rows: see `measure`.
    """
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    columns = min(3, len(scenes))
    lines = -(-len(scenes) // 3)
    figure = Figure(figsize=(5 * columns, 4.3 * lines), dpi=110, layout="constrained")
    for number, scene in enumerate(scenes, 1):
        panel = figure.add_subplot(
            lines, columns, number, xscale="log", yscale="log", ylim=(LOWEST, HIGHEST)
        )
        title = f"{scene}, one grasp each"
        if "record" not in scene:
            title = f"lambda h = {float(scene):.0e}"
        panel.set(xlabel="seconds", ylabel="relative error", title=title)
        panel.axhline(1e-2, color="0.8", lw=1)
        for color, method in enumerate(STYLES):
            runs = [row for row in rows if row["scene"] == scene and row["method"] == method]
            if runs:
                _draw(panel, runs, method, f"C{color}")
        panel.legend(fontsize=7)
    figure.suptitle(
        "Error of the sensors' forces against run time\nx: diverged or gave up; grey line: 1 %"
    )
    return figure


def _draw(panel: Axes, runs: list[Row], method: str, color: str) -> None:
    """Draw the line of a method, and crosses for its failed runs."""
    seconds = np.array([row["seconds"] for row in runs])
    error = np.array([row["error"] for row in runs])
    failed = np.isnan(error)
    good = np.clip(error[~failed], LOWEST, HIGHEST)
    crosses = np.full(failed.sum(), FAILED)
    line_label: str | None = method
    cross_label: str | None = None
    if failed.all():
        line_label = None
        cross_label = f"{method}: failed"
    panel.plot(seconds[~failed], good, STYLES[method], color=color, label=line_label)
    panel.plot(seconds[failed], crosses, "x", color=color, label=cross_label)


if __name__ == "__main__":
    solver()
