"""Integration: its order, its tolerance, and steps that are far too long.

No hand waits for another.
"""

import numpy as np
import pytest

from tactile_viewgcn.glove import integrator
from tactile_viewgcn.glove.integrator import ImplicitIntegrator
from tactile_viewgcn.glove.mechanics import HOLDING, JOINT, TENDON
from tests.glove.scenes import LAYER, free_finger, radau, sphere_on_bed

FRAME = 0.1  # s
# m per rad and m per m: factors that make errors of joints and positions comparable
UNITS = np.array([0.05] * 10 + [1.0] * 3)


def test_half_the_step_leaves_a_quarter_of_the_error():
    mechanics, y = sphere_on_bed()
    exact = radau(mechanics, y, 1, frame=FRAME, rtol=1e-9)[0, 0]
    errors = []
    for steps in (2, 4, 8, 16):
        solver = ImplicitIntegrator(mechanics, FRAME, 1e-6, step=FRAME / steps)
        errors.append(np.abs(solver.run(y, 1)[0, 0] - exact) * UNITS)
        assert solver.statistics["steps"] == steps
        assert solver.statistics["unsolved"] == 0
    for part in (slice(0, 10), slice(10, 13)):
        worst = np.max(np.array(errors)[:, part], axis=1)
        assert worst[0] < 2e-4
        assert (np.log2(worst[:-1] / worst[1:]) > 1.8).all()
        assert np.log2(worst[-2] / worst[-1]) == pytest.approx(2, abs=0.15)


@pytest.mark.parametrize("damping", [0.01, 0.05])
def test_without_contact_a_finger_relaxes_exponentially_to_its_posture(damping):
    squeeze = np.array([0.0, 0.05, 0.1, 0.02, 0.03])
    mechanics = free_finger(posture=0.6, squeeze=squeeze, knots=4, joint_damping=damping)
    y = np.array([[0.2] * 10 + [0, 0, 0.45]])
    states = ImplicitIntegrator(mechanics, FRAME, 1e-3).run(y, 3)[0]
    time = FRAME * np.arange(1, 4)
    end = 0.6 + squeeze[:, None] * TENDON / JOINT  # (5, 2)
    for knot, now in enumerate(time):
        exact = end + (0.2 - end) * np.exp(-now * JOINT / damping)
        np.testing.assert_allclose(states[knot, :10].reshape(5, 2), exact, atol=1e-4)
    height = 0.5 - 0.05 * np.exp(-time * HOLDING / LAYER.object_damping)
    np.testing.assert_allclose(states[:, 12], height, atol=2e-6)


def test_where_no_step_is_good_enough_the_smallest_ones_end_the_frame(monkeypatch):
    monkeypatch.setattr(integrator, "SMALLEST", 0.05)
    solver = ImplicitIntegrator(free_finger(joint_damping=0.05), FRAME, 1e-13)
    states = solver.run(np.array([[0.2] * 10 + [0, 0, 0.45]]), 1)
    assert np.isfinite(states).all()
    assert solver.statistics["steps"] - solver.statistics["rejected"] == 20
    assert solver.statistics["forced"] >= 19
