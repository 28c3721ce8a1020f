"""The work-precision benchmark: the other integrators solve the same equation, and the table measures what it says."""

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.solver import __main__ as solver
from benchmarks.solver.other_integrators import IntegrationFailed, explicit_euler, integrate_with_scipy
from benchmarks.solver.scenes import SETTINGS, ball_grasp, stiffness
from tactile_viewgcn.glove.contact import JOINT
from tactile_viewgcn.glove.integrator import ImplicitIntegrator
from tests.gloves import FRAME, error_of_state, free_finger, radau, sphere_on_bed


def test_explicit_euler_has_order_one_and_fails_where_the_equation_is_stiff_as_others_do_after_too_many_steps():
    mechanics, y = sphere_on_bed()
    solution = radau(mechanics, y)
    states = (explicit_euler(mechanics, y, 1, FRAME, steps)[0, 0] for steps in (64, 128))
    coarse, fine = (error_of_state(state, solution) for state in states)
    assert fine < 1e-4 and coarse / fine == pytest.approx(2, rel=0.1)
    with pytest.raises(IntegrationFailed, match="diverged in frame 0"):
        explicit_euler(free_finger(joint_damping=1e-6), y, 1, FRAME, 64)
    with pytest.raises(IntegrationFailed, match="spent 5 evaluations"):
        integrate_with_scipy("BDF", mechanics, 0, y[0], 1, FRAME, rtol=1e-6, max_evaluations=5)


def test_the_stiffness_of_free_joints_is_spring_over_damping():
    mechanics = free_finger(joint_damping=0.05)
    states = np.tile([0.2] * 10 + [0, 0, 0.5], (1, 1, 1))
    mechanics.damping[10:] = 1e9  # the object's part vanishes
    assert stiffness(mechanics, states, FRAME) == pytest.approx(JOINT.max() / 0.05 * FRAME)


def test_relative_error_is_the_median_of_recordings_that_are_pressed():
    pressure = np.zeros((4, 2, 3))
    pressure[1:, 0, 0] = 2.0
    off = pressure.copy()
    off[1:, 1, 1] = [0.2, 0.4, 2.0]
    assert solver.relative_error(off, pressure) == pytest.approx(0.2)


def test_rows_have_error_and_cost_and_failures_their_reason(monkeypatch):
    simulation = ball_grasp(*SETTINGS[1], rate=7.35, seed=1)

    def solve(method, setting, mechanics, *_):
        if method == "explicit Euler":
            raise IntegrationFailed("diverged in frame 3")
        y = mechanics.initial_state()
        return ImplicitIntegrator(mechanics, 1 / 7.35, 0.2).run(y, 22), 7

    monkeypatch.setattr(solver, "solve", solve)
    good, failed = solver.measure(simulation, {"ours": (0.2,), "explicit Euler": (1,)}, 1e-3, 100)
    assert (good["error"], good["evaluations"], good["remark"]) == (0, 7, "")
    assert np.isnan(failed["error"]) and failed["remark"] == "diverged in frame 3"
    assert 0.1 < float(good["scene"]) < 10  # lambda h of a soft ball
    assert len(solver.diagram([good | {"error": 1e-3}, failed]).axes[0].get_lines()) == 5  # two a method, and 1 %


@pytest.mark.parametrize(
    ("method", "setting"),
    [("ours", 0.02), ("ours, fixed steps", 4), ("explicit Euler", 64), ("RK45", 1e-4), ("BDF", 1e-4)],
)
def test_every_method_ends_where_radau_does(method, setting):
    simulation = ball_grasp(*SETTINGS[0], rate=7.35, seed=1)
    mechanics = simulation.mechanics(0, 22)
    exact, _ = solver.solve("Radau", 1e-5, mechanics, simulation.recipe, 10_000)
    states, evaluations = solver.solve(method, setting, mechanics, simulation.recipe, 10_000)
    assert states.shape == exact.shape == (1, 22, 13) and evaluations >= 22
    assert np.abs(states - exact).max() < 0.02


def test_the_quick_run_measures_one_ball_and_one_object_at_two_settings(monkeypatch):
    calls = []
    row = {"scene": "1.0e+01", "method": "ours", "setting": "0.02", "error": 1e-3, "seconds": 0.1}
    monkeypatch.setattr(solver, "measure", lambda *args: calls.append(args) or [row])
    result = CliRunner().invoke(solver.solver, ["--quick"], catch_exceptions=False)
    assert result.exit_code == 0 and "| 1.0e+01 | ours     | 0.02      | 0.001   | 0.1 " in result.output
    ball, coin = calls
    assert [len(simulation.cells) for simulation, *_ in calls] == [1, 2]  # the empty hand is the coin's other
    assert {len(settings) for settings in ball[1].values()} == {2} and set(coin[1]) == {"ours", "Radau"}
