"""The virtual glove's contact: stiff, sudden, deep and for long.

The contact is solved with `ImplicitIntegrator`, as in the pipeline. The error of forces is the norm
of the difference from the reference, over frames and sensors, relative to the norm of the
reference. The integrator's own tolerance decides which error is right: it allows the sensors'
forces a relative error of TOLERANCE in a step. The errors of a frame's steps can add up, but fade
on the way to rest. So TOLERANCE for a whole grasp is a stricter demand.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from benchmarks.stability.rows import share_not_finite
from tactile_viewgcn.glove.integrator import FORCE_FLOOR, ImplicitIntegrator
from tactile_viewgcn.glove.mechanics import HOLDING, JOINT, LEVER, TENDON
from tactile_viewgcn.glove.scene import AWAY
from tactile_viewgcn.glove.shapes import sphere
from tests.glove.scenes import (
    BALL,
    BALL_AT,
    FRAME,
    GRASPS,
    LAYER,
    around_a_ball,
    forces,
    grasp,
    lambda_h,
    plate,
    radau,
    rel_norm_error,
    rod,
    scene,
    skin,
)

TOLERANCE = 0.02  # of params.yaml
HALF_CLOSED = 0.7  # rad


def solved(mechanics, y, frames, **options):
    """Return states (B, frames, n), and a remark about the integrator's work."""
    integrator = ImplicitIntegrator(mechanics, FRAME, **options)
    states = integrator.run(y, frames)
    names = {
        "steps": "steps",
        "rejected": "rejected",
        "unsolved": "stages unsolved",
        "forced": "forced",
    }
    counts = [f"{integrator.statistics[name]} {text}" for name, text in names.items()]
    return states, ", ".join(counts)


def wedge(setting):
    """Return a ball between the tips of thumb and index finger.

    The two lean towards each other and squeeze ever harder.
    """
    mechanics = scene(
        [[sphere(0.03)]],  # m
        [0.083, 0.027, 0.071],  # m
        posture=np.array([[0.1, 0.1]] * 3 + [[0.8, 0.64], [0.3, 0.24]]),
        layer=skin(setting),
        stiffness=setting[1],
        knots=6,
        opposition=0.95,
    )
    mechanics.drive.squeeze[..., 3:] = 0.05 * np.arange(6)[:, None]  # N m
    return mechanics


def case(check, make, frames):
    """Return a case of the test below."""
    marks = [pytest.mark.stability(check), pytest.mark.slow]
    return pytest.param(make, frames, marks=marks, id=check)


@pytest.mark.parametrize(
    ("make", "frames"),
    [
        # Beyond lambda h = 1e6 Radau takes minutes.
        *(
            case("stiffness of a grasp", partial(grasp, setting, seed=3000, frames=6), 6)
            for setting in GRASPS
        ),
        *(case("fingers stopped by a rod", partial(rod, damping), 2) for damping in (1e-3, 1e-4)),
        *(
            case("wedged between two fingers", partial(wedge, setting), 5)
            for setting in GRASPS[3:6]
        ),
    ],
)
def test_the_sensors_forces_are_radau_s(row, make, frames):
    mechanics = make()
    y = mechanics.initial_state()
    states, work = solved(mechanics, y, frames)
    exact = forces(mechanics, radau(mechanics, y, frames))
    error = rel_norm_error(forces(mechanics, states), exact)
    row(f"forces against Radau's, {lambda_h(mechanics, states)}", error, TOLERANCE, work)


@pytest.mark.stability("stiffness of a plate")
def test_a_loaded_plate_on_the_palm_has_the_forces_of_its_closed_form(row):
    """From lambda h = 1e4 on the plate is at rest at every moment.

    Then the test only asks that the integrator solves the equation at all.
    """
    for decade in range(-2, 9):
        mechanics, y, exact = plate(10.0**decade, frames=4)
        states, work = solved(mechanics, y, 4)
        error = rel_norm_error(forces(mechanics, states), exact)
        stiff = lambda_h(mechanics, states)
        row(f"forces against the closed form, {stiff}", error, TOLERANCE, work)


@pytest.mark.slow
@pytest.mark.stability("steps of a whole frame")
@pytest.mark.parametrize("setting", GRASPS[3:7], ids=lambda setting: f"{setting[0]:g}")
def test_steps_far_too_long_stay_bounded_and_come_to_the_same_rest(row, setting):
    """The object stays nearer than AWAY, where it comes from, and fingers within half a turn."""
    mechanics = around_a_ball(setting, HALF_CLOSED, knots=13, squeeze=0.1, load=(0.1, -0.2, -0.5))
    y = mechanics.initial_state()
    y[:, :10] = 0.15
    long, work = solved(mechanics, y, 12, step=FRAME)
    short, _ = solved(mechanics, y, 12)
    stiff = lambda_h(mechanics, short)
    row(f"states that are not finite, {stiff}", share_not_finite(long), 0, work)
    largest_angle = np.abs(long[..., :10]).max()
    largest_way = np.abs(long[..., 10:] - BALL_AT).max()
    reach = max(largest_angle / np.pi, largest_way / AWAY)
    row(f"largest angle over pi, or way over AWAY, {stiff}", reach, 1, work)
    rest = rel_norm_error(forces(mechanics, long)[:, -1], forces(mechanics, short)[:, -1])
    row(f"forces at rest against those of short steps, {stiff}", rest, TOLERANCE, work)


@pytest.mark.stability("damping")
def test_with_next_to_no_damping_the_hand_is_where_the_springs_balance(row):
    """A torque is right within Newton's goal and the torque of the damping itself.

    Newton's goal is 0.2 TOLERANCE of the least force that counts.
    """
    goal = 0.2 * TOLERANCE * FORCE_FLOOR
    for smallness in (1e-3, 1e-6, 1e-9):
        joint = LAYER.joint_damping * smallness
        motion = LAYER.object_damping * smallness
        mechanics = scene(
            [[BALL]],
            [0.08, 0, 0.3],
            posture=HALF_CLOSED,
            layer=replace(LAYER, joint_damping=joint, object_damping=motion),
            squeeze=0.1,
            knots=5,
            load=(0, 0, -3.0),
        )
        mechanics.drive.posture[0] += 0.2 * np.sin(np.arange(5))[:, None, None]
        states, work = solved(mechanics, mechanics.initial_state(), 4)
        exact = mechanics.drive.posture[0, 1:] + 0.1 * TENDON / JOINT
        torque = np.abs(states[0, :, :10].reshape(4, 5, 2) - exact).max(axis=(0, 1)) * JOINT
        lag = 0.2 / FRAME * joint  # N m: torque of the damping behind a posture that moves
        stiff = lambda_h(mechanics, states)
        row(f"torque that is not balanced, N m, {stiff}", torque.max(), goal * LEVER + lag, work)
        force = HOLDING * np.abs(states[0, :, 12] - (0.3 - 3.0 / HOLDING)).max()
        row(f"force that is not balanced, N, {stiff}", force, goal, work)


@pytest.mark.slow
@pytest.mark.stability("deep at first")
@pytest.mark.parametrize("setting", GRASPS[3:6], ids=lambda setting: f"{setting[0]:g}")
def test_fingers_that_begin_inside_a_ball_come_out_where_radau_does(row, setting):
    mechanics = around_a_ball(setting, HALF_CLOSED, knots=7)
    y = mechanics.initial_state()
    y[:, :10] = 1.2
    balance = mechanics.evaluate(np.zeros(1, dtype=int), np.zeros(1), y, palm=True)
    depth = 1e3 * balance.contacts.depth.max()  # mm
    states, work = solved(mechanics, y, 6)
    remark = f"{depth:.3g} mm deep; {work}"
    stiff = lambda_h(mechanics, states)
    row(f"states that are not finite, {stiff}", share_not_finite(states), 0, remark)
    exact = forces(mechanics, radau(mechanics, y, 6))
    error = rel_norm_error(forces(mechanics, states)[:, -1], exact[:, -1])
    row(f"forces at the end against Radau's, {stiff}", error, TOLERANCE, remark)


@pytest.mark.stability("steps and tolerances")
def test_in_the_default_layer_no_step_is_kept_in_spite_of_its_error(row):
    mechanics = grasp(GRASPS[3], seed=3000, frames=8)
    integrator = ImplicitIntegrator(mechanics, FRAME, TOLERANCE)
    integrator.run(mechanics.initial_state(), 8)
    row("steps kept in spite of their error, default layer", integrator.statistics["forced"])
