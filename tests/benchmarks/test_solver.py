"""The benchmark of integrators measures their errors in one equation that all of them solve."""

import numpy as np
import pytest

from benchmarks.solver import __main__ as solver
from benchmarks.solver.other_integrators import (
    IntegrationFailed,
    explicit_euler,
    integrate_with_scipy,
)
from benchmarks.solver.scenes import SETTINGS, ball_grasp
from tests.glove.scenes import FRAME, free_finger, sphere_on_bed


@pytest.mark.parametrize(
    ("method", "setting"),
    [
        ("ours", 0.02),
        ("ours, fixed steps", 4),
        ("explicit Euler", 64),
        ("RK45", 1e-4),
        ("BDF", 1e-4),
    ],
)
def test_every_method_ends_where_radau_does(method, setting):
    simulation = ball_grasp(*SETTINGS[0], seed=1)
    mechanics = simulation.mechanics(0, 22)
    exact, _ = solver.solve("Radau", 1e-5, mechanics, 10_000)
    states, evaluations = solver.solve(method, setting, mechanics, 10_000)
    assert states.shape == exact.shape == (1, 22, 13) and evaluations >= 22
    assert np.abs(states - exact).max() < 0.02


def test_a_method_fails_where_the_equation_is_stiff_or_after_too_many_evaluations():
    mechanics, y = sphere_on_bed()
    with pytest.raises(IntegrationFailed, match="frame 0"):
        explicit_euler(free_finger(joint_damping=1e-6), y, 1, FRAME, 64)
    with pytest.raises(IntegrationFailed, match="5 evaluations"):
        integrate_with_scipy("BDF", mechanics, 0, y[0], 1, FRAME, rtol=1e-6, max_evaluations=5)
