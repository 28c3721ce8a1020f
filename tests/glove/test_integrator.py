"""Integration: its order, its tolerance, what a far too long step does, and that no hand waits for another."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tactile_viewgcn.glove.comparison import GaveUp, by_scipy, explicit_euler
from tactile_viewgcn.glove.contact import HOLDING, JOINT, LEVER, TENDON, Drive, Mechanics
from tactile_viewgcn.glove.hand import Hands, stag_hand
from tactile_viewgcn.glove.integrator import Implicit
from tactile_viewgcn.glove.objects import THINGS, Thing
from tactile_viewgcn.glove.shapes import sphere
from tests.gloves import FITS, HELD, LAYER, bed, gripping, solids, still

FRAME, RADIUS = 0.1, 0.1  # s, m
BALL = Thing("ball", 1, 1e15, (sphere(RADIUS),))
UNITS = np.array([0.05] * 10 + [1.0] * 3)  # m per rad and per m: errors of joints and places compare


def smooth():
    """A sphere that stays in contact with all of a small bed's sensors while it moves, and its state at first."""
    layer = replace(LAYER, stiffness=1e6)
    drive = still([0.002, 0.001, RADIUS - 0.001], load=(0, 0, -3.0), posture=np.full((5, 2), 0.3), squeeze=0.05)
    mechanics = Mechanics(Hands([bed(4, 0.01)]), solids(BALL), np.array([1e12]), drive, layer, motion=True)
    return mechanics, np.array([[0.1] * 10 + [0, 0, RADIUS - 0.003]])


def reference(mechanics, y):
    """The state a frame later, from SciPy."""
    row = np.zeros(1, dtype=int)

    def speed(time, state):
        return -mechanics.balance(row, time[None] / FRAME, state[None], palm=True).residual[0] / mechanics.damping

    found = solve_ivp(lambda t, s: speed(np.array(t), s), (0, FRAME), y[0], method="Radau", rtol=1e-9, atol=1e-12)
    return found.y[:, -1]


def alone(mechanics, row, thing, fit):
    """The mechanics of one row."""
    drive = Drive(**{name: values[row : row + 1] for name, values in vars(mechanics.drive).items()})
    return Mechanics(
        Hands([fit]), solids(thing), np.array([thing.stiffness]), drive, mechanics.layer, motion=mechanics.motion
    )


def test_half_the_step_leaves_a_quarter_of_the_error():
    mechanics, y = smooth()
    exact, errors = reference(mechanics, y), []
    for steps in (2, 4, 8, 16):
        integrator = Implicit(mechanics, FRAME, 1e-6, step=FRAME / steps)
        errors.append(np.abs(integrator.run(y, 1)[0, 0] - exact) * UNITS)
        assert integrator.work.steps == steps and integrator.work.unsolved == 0
    for part in (slice(0, 10), slice(10, 13)):
        worst = np.max(np.array(errors)[:, part], axis=1)
        assert worst[0] < 2e-4 and (np.log2(worst[:-1] / worst[1:]) > 1.8).all()
        assert np.log2(worst[-2] / worst[-1]) == pytest.approx(2, abs=0.15)


def test_a_tighter_tolerance_gives_a_smaller_error():
    mechanics, y = smooth()
    exact, errors, steps = reference(mechanics, y), [], []
    for tolerance in (1e-1, 1e-2, 1e-3):
        integrator = Implicit(mechanics, FRAME, tolerance)
        errors.append(np.max(np.abs(integrator.run(y, 1)[0, 0] - exact) * UNITS))
        steps.append(integrator.work.steps)
    assert errors[0] < 1e-3 and errors[1] < errors[0] / 3 and errors[2] < errors[1] / 3
    assert steps[0] < steps[1] < steps[2]


@pytest.mark.parametrize("stiffness", [1e4, 1e6, 1e8, 1e10, 1e12])
def test_steps_of_a_whole_frame_reach_the_state_of_short_ones_however_stiff_the_layer(stiffness):
    place, load = np.array([0.0005, -0.0003, RADIUS + 0.001]), np.array([0, 0, -5.0])
    drive = still(place, load=load, posture=np.full((5, 2), 0.3), squeeze=0.05, knots=9)
    layer = replace(LAYER, stiffness=stiffness)
    mechanics = Mechanics(Hands([bed(16, 0.04)]), solids(BALL), np.array([1e15]), drive, layer, motion=True)
    y = mechanics.start()
    long, short = (Implicit(mechanics, FRAME, 1e-2, step=step).run(y, 8) for step in (FRAME, None))
    away = np.abs(long - short)[0]
    assert np.isfinite(long).all() and away[0, 10:].max() < 1e-3 and away[0, :10].max() < 0.05
    assert away[-1, 10:].max() < 1e-5 and away[-1, :10].max() < 1e-3
    assert place[2] + load[2] / HOLDING < long[0, -1, 12] < place[2]  # between no bed and no load


@pytest.mark.parametrize("motion", [False, True])
@pytest.mark.parametrize("stiffness", [1e5, 1e8, 1e12])
def test_steps_of_a_whole_frame_stay_bounded_where_fingers_run_into_things(stiffness, motion):
    mechanics, y = gripping(motion=motion, seed=1)
    y[:, :10] = 0.15
    drive = Drive(**{name: np.repeat(values, 2, axis=1) for name, values in vars(mechanics.drive).items()})
    hard = replace(LAYER, stiffness=stiffness)
    stiff = np.full(len(HELD), 1e15)
    mechanics = Mechanics(mechanics.hands, mechanics.solids, stiff, drive, hard, motion=motion)
    states = Implicit(mechanics, FRAME, step=FRAME).run(y, 3)
    assert np.isfinite(states).all() and np.abs(states[..., :10]).max() < 3  # rad
    if motion:
        assert np.abs(states[..., 10:] - drive.place[:, :1]).max() < 0.2  # m


@pytest.mark.parametrize("motion", [False, True])
def test_a_hand_moves_the_same_alone_and_among_others(motion):
    mechanics, y = gripping(motion=motion, seed=1)
    mechanics.drive.posture[:, 1:] += 0.2
    drive = Drive(**{name: np.repeat(values, 2, axis=1) for name, values in vars(mechanics.drive).items()})
    stiffness = np.array([thing.stiffness for thing in HELD])
    mechanics = Mechanics(mechanics.hands, mechanics.solids, stiffness, drive, LAYER, motion=motion)
    together = Implicit(mechanics, FRAME, 0.05).run(y, 3)
    for row, thing in enumerate(HELD):
        single = alone(mechanics, row, thing, stag_hand(**FITS[row]))
        own = Implicit(single, FRAME, 0.05).run(y[row : row + 1], 3)
        np.testing.assert_allclose(own[0], together[row], rtol=0, atol=1e-12)


def empty(drive, **layer):
    one = Hands([bed(4, 0.01)])
    return Mechanics(one, solids(THINGS[0]), np.array([1e9]), drive, replace(LAYER, **layer), motion=True)


@pytest.mark.parametrize("damping", [0.01, 0.05])
def test_without_contact_a_finger_relaxes_exponentially_to_its_posture(damping):
    squeeze = np.array([0.0, 0.05, 0.1, 0.02, 0.03])
    drive = still([0, 0, 0.5], posture=np.full((5, 2), 0.6), squeeze=squeeze, knots=4)
    mechanics = empty(drive, joint_damping=damping)
    y = np.array([[0.2] * 10 + [0, 0, 0.45]])
    states = Implicit(mechanics, FRAME, 1e-3).run(y, 3)[0]
    time = FRAME * np.arange(1, 4)
    end = 0.6 + squeeze[:, None] * TENDON / JOINT  # (5, 2)
    for knot, now in enumerate(time):
        exact = end + (0.2 - end) * np.exp(-now * JOINT / damping)
        np.testing.assert_allclose(states[knot, :10].reshape(5, 2), exact, atol=1e-4)
    np.testing.assert_allclose(states[:, 12], 0.5 - 0.05 * np.exp(-time * HOLDING / LAYER.object_damping), atol=2e-6)


def test_a_finger_follows_a_posture_that_moves_from_frame_to_frame():
    drive = still([0, 0, 0.5], knots=5)
    drive.posture[0, :, :, 0] = np.array([0.2, 0.3, 0.4, 0.5, 0.6])[:, None]  # 1 rad/s
    drive.posture[0, :, :, 1] = 0.2
    mechanics = empty(drive)
    y = np.array([[0.2] * 10 + [0, 0, 0.5]])
    states = Implicit(mechanics, FRAME, 1e-3).run(y, 4)[0]
    lag = LAYER.joint_damping / JOINT[0]  # s
    time = FRAME * np.arange(1, 5)
    exact = 0.2 + time - lag * (1 - np.exp(-time / lag))
    np.testing.assert_allclose(states[:, 0:10:2], np.tile(exact[:, None], 5), atol=2e-4)
    np.testing.assert_allclose(states[:, 1:10:2], 0.2, atol=1e-6)


def test_the_work_is_counted():
    mechanics, y = smooth()
    integrator = Implicit(mechanics, FRAME, step=FRAME / 4)
    states = integrator.run(y, 1)
    assert states.shape == (1, 1, 13)
    assert integrator.work.steps == 4 and integrator.work.rejected == 0 and integrator.work.evaluations >= 16


@pytest.mark.parametrize("name", ["frame", "tolerance", "step"])
@pytest.mark.parametrize("value", [0, -0.1, np.inf, np.nan])
def test_a_frame_tolerance_or_step_that_is_not_above_zero_is_refused(name, value):
    given = {"frame": FRAME, "tolerance": 0.1, "step": 0.1} | {name: value}
    with pytest.raises(ValueError, match=rf"{name} is {value}; expected more than 0, and finite"):
        Implicit(smooth()[0], **given)


@pytest.mark.parametrize("method", ["RK45", "BDF", "Radau"])
def test_scipys_integrators_of_the_comparison_solve_the_same_equation(method):
    mechanics, y = smooth()
    found, spent = by_scipy(method, mechanics, 0, y[0], 1, FRAME, rtol=1e-6, most=20_000)
    assert found.shape == (1, 13) and 10 < spent <= 20_000
    assert np.max(np.abs(found[0] - reference(mechanics, y)) * UNITS) < 1e-6


def test_explicit_euler_of_the_comparison_has_order_one_and_blows_up_where_it_is_stiff():
    mechanics, y = smooth()
    exact = reference(mechanics, y)
    coarse, fine = (
        np.max(np.abs(explicit_euler(mechanics, y, 1, FRAME, steps)[0, 0] - exact) * UNITS) for steps in (64, 128)
    )
    assert fine < 1e-4 and coarse / fine == pytest.approx(2, rel=0.1)
    stiff = empty(still([0, 0, 0.5], posture=np.full((5, 2), 0.3)), joint_damping=1e-6)
    with pytest.raises(GaveUp, match="blew up in frame 0"):
        explicit_euler(stiff, y, 1, FRAME, 64)
    with pytest.raises(GaveUp, match="spent 5 evaluations"):
        by_scipy("BDF", mechanics, 0, y[0], 1, FRAME, rtol=1e-6, most=5)


def test_joint_and_object_are_solved_to_goals_of_one_size():
    mechanics = Mechanics(
        Hands([stag_hand()]), solids(THINGS[2]), np.ones(1), still([[0.08, 0, 0.1]]), LAYER, motion=True
    )
    force, arm = 3.0, LEVER  # N on the object, and the torque that it makes on a joint at the usual distance
    assert force * mechanics.lever[10] == pytest.approx(force * arm * mechanics.lever[0])
