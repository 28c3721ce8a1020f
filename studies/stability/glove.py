"""The virtual glove's contact: stiff, sudden, deep, for long, and refused.

All cases solve the contact with `Implicit`, as the pipeline does. Where a finding compares forces, its error is the
norm of the difference over frames and sensors relative to the reference's, and what is right follows from the
integrator's own tolerance: it allows the sensors' forces a relative error of TOLERANCE in a step. Steps of a frame
may add their errors up, though on the way to rest they fade; so TOLERANCE for a whole grasp asks for more.
"""

from collections.abc import Iterator

import numpy as np

from studies.glove_solver.scenes import stiffness
from studies.stability.case import Finding, Subject, finite, refusal
from studies.stability.glove_scenes import (
    DEFAULT,
    FRAME,
    energies,
    forces,
    grasp,
    held,
    off,
    plate,
    radau,
    repeated_grasp,
)  # fmt: skip
from tactile_viewgcn.glove.contact import HOLDING, JOINT, LEVER, TENDON, Layer
from tactile_viewgcn.glove.integrator import FLOOR, Implicit
from tactile_viewgcn.glove.scene import AWAY
from tactile_viewgcn.glove.shapes import capsule, sphere

TOLERANCE = 0.02  # of params.yaml
SEED = 3000  # of studies/glove_solver
#: of a grasp, for each decade of lambda h: skin Pa/m, object Pa/m, joints N m s/rad, object N s/m
GRASPS = (
    (3e4, 1e6, 5.0, 2e4),
    (3e4, 1e6, 0.5, 2e3),
    (4e6, 1e7, 0.1, 300.0),
    (2.5e7, 2e7, 0.02, 60.0),
    (2e8, 1e9, 0.01, 30.0),
    (5e9, 2.5e10, 0.01, 30.0),
    (5e10, 2.5e11, 0.01, 30.0),
    (3e10, 1e11, 0.0007, 2.0),
    (3e11, 1e12, 0.0007, 2.0),
)
ROLLING = (5e9, 2.5e10, 0.01, 30.0), 1  # a setting and a seed: the ball rolls from one sensor to the next
HALF_CLOSED = np.full((5, 2), 0.7)  # rad
WEDGE = (0.083, 0.027, 0.071)  # m: amid the tips of thumb and index finger, which lean towards each other
BALL, BALL_AT = sphere(0.034), (0.075, 0.0, 0.037)  # m: above the palm, so that only fingers touch it at first


def solved(mechanics, y: np.ndarray, frames: int, **given) -> tuple[np.ndarray, str]:
    """States (B, frames, n), and what the integration counts as not solved."""
    integrator = Implicit(mechanics, FRAME, **given)
    states, work = integrator.run(y, frames), integrator.work
    said = f"{work.steps} steps, {work.rejected} rejected, {work.unsolved} stages unsolved"
    return states, said if "step" in given else f"{said}, {work.forced} forced"


def stiffness_of_a_grasp(subject: Subject) -> Iterator[Finding]:
    """The fingers close on a ball, squeeze and hold it, from lambda h = 0.01 to 1e6; beyond, Radau takes minutes.

    At the last a ball rolls from one sensor to the next: there the errors of a frame's 16 steps add up to more than
    that of one, so it is asked for a tighter tolerance, and the remark has the error at the usual one.
    """
    for setting in GRASPS:
        mechanics = grasp(setting, seed=SEED, frames=6)
        y = mechanics.start()
        states, counted = solved(mechanics, y, 6)
        error = off(forces(mechanics, states), forces(mechanics, radau(mechanics, y, 6)))
        yield Finding(f"forces against Radau's, {lambda_h(mechanics, states)}", error, TOLERANCE, counted)
    mechanics = grasp(ROLLING[0], seed=ROLLING[1], frames=4)
    y = mechanics.start()
    exact = forces(mechanics, radau(mechanics, y, 4))
    usual, tight = (solved(mechanics, y, 4, tolerance=wanted) for wanted in (TOLERANCE, TOLERANCE / 4))
    said = (
        f"{lambda_h(mechanics, tight[0])}; at {TOLERANCE:g}: {off(forces(mechanics, usual[0]), exact):.2g}; {tight[1]}"
    )
    quantity = f"forces against Radau's, rolling, solved to {TOLERANCE / 4:g}"
    yield Finding(quantity, off(forces(mechanics, tight[0]), exact), TOLERANCE, said)


def stiffness_of_a_plate(subject: Subject) -> Iterator[Finding]:
    """A loaded plate on the palm has a closed form, so that it goes on to lambda h = 1e8.

    From 1e4 on the plate is at rest at every moment and its sensors carry the load: the closed form then asks that
    so stiff a layer is solved at all, no longer how fast the plate sinks in.
    """
    for decade in range(-2, 9):
        mechanics, y, exact = plate(10.0**decade, frames=4)
        states, counted = solved(mechanics, y, 4)
        error = off(forces(mechanics, states), exact)
        yield Finding(f"forces against the closed form, {lambda_h(mechanics, states)}", error, TOLERANCE, counted)


def steps_of_a_whole_frame(subject: Subject) -> Iterator[Finding]:
    """Far too long for the scene, yet bounded; and where the drive stands still, both ways come to the same rest.

    Bounded: the energy of the springs that hold object and fingers is no more than what the start had (the forces of
    start and drive do the rest); the object stays nearer than the AWAY that it comes from, the fingers within a turn.
    """
    for setting in GRASPS[3:7]:
        mechanics = held(
            [BALL], [BALL_AT], HALF_CLOSED, layer=Layer(setting[0], DEFAULT.thickness, *setting[2:]),
            stiffness=setting[1], knots=13, squeeze=0.1, opposition=0.9, load=(0.1, -0.2, -0.5),
        )  # fmt: skip
        y = mechanics.start()
        y[:, :10] = 0.15
        long, counted = solved(mechanics, y, 12, step=FRAME)
        short, _ = solved(mechanics, y, 12)
        stiff = lambda_h(mechanics, short)
        said = f"{counted}"
        yield Finding(f"states that are not finite, {stiff}", finite(long), 0.0, said)
        reach = max(np.abs(long[..., :10]).max() / np.pi, np.abs(long[..., 10:] - BALL_AT).max() / AWAY)
        yield Finding(f"largest angle over pi, or way over AWAY, {stiff}", float(reach), 1.0, said)
        rest = off(forces(mechanics, long)[:, -1], forces(mechanics, short)[:, -1])
        yield Finding(f"forces at rest against those of short steps, {stiff}", rest, TOLERANCE, said)


def contact_within_a_step(subject: Subject) -> Iterator[Finding]:
    """A ball, prescribed or drawn behind its spring, flies past the fingers between two frames and bends them.

    Of a pen, whose contact is shorter than any that the integrator looks for, it would still miss a part.

    The angles at the frames are compared with those of 128 steps a frame, in thicknesses of the skin over LEVER, by
    which the integrator measures places.
    """
    for motion, end in ((False, 0.07), (False, 0.12), (True, 0.07), (True, 0.12)):  # m
        posture = np.full((5, 2), 0.6)
        mechanics = held([sphere(0.03)], [[0.13, -0.12, 0.03]], posture, knots=4, motion=motion)
        mechanics.drive.place[0, 2:, 1] = end
        y = mechanics.start()
        (found, counted), (exact, _) = solved(mechanics, y, 3), solved(mechanics, y, 3, step=FRAME / 128)
        error = np.abs(found - exact)[..., :10].max() * LEVER / DEFAULT.thickness
        bent = np.abs(exact[..., :10] - 0.6).max()
        what = f"angles at the frames, {'drawn' if motion else 'prescribed'} to {end} m"
        yield Finding(what, float(error), TOLERANCE, f"fingers bent by {bent:.2g} rad; {counted}")


def fingers_stopped_by_a_rod(subject: Subject) -> Iterator[Finding]:
    """Hardly damped fingers close within a frame to where they would be behind the rod in their way."""
    rod = capsule(0.012, 0.2, turn=(np.pi / 2, 0, 0))  # across the fingers
    for joint in (1e-3, 1e-4):  # N m s/rad
        layer = Layer(DEFAULT.stiffness, DEFAULT.thickness, joint, DEFAULT.object_damping)
        mechanics = held([rod], [[0.105, 0, 0.05]], np.full((5, 2), 0.1), layer=layer, knots=3, motion=False)
        mechanics.drive.posture[0, 2:] = 1.5
        y = mechanics.start()
        states, counted = solved(mechanics, y, 2)
        error = off(forces(mechanics, states), forces(mechanics, radau(mechanics, y, 2)))
        bent = states[0, -1, :8:2].max()
        stiff = lambda_h(mechanics, states)
        said = f"stopped at {bent:.2g} rad of 1.5; {counted}"
        yield Finding(f"forces against Radau's, {stiff}", error, TOLERANCE, said)


def wedged_between_two_fingers(subject: Subject) -> Iterator[Finding]:
    """A ball between the tips of thumb and index finger, squeezed ever harder."""
    for setting in GRASPS[3:6]:
        layer = Layer(setting[0], DEFAULT.thickness, *setting[2:])
        posture = np.array([[0.1, 0.1]] * 3 + [[0.8, 0.64], [0.3, 0.24]])
        mechanics = held([sphere(0.03)], [WEDGE], posture, layer=layer, stiffness=setting[1], knots=6, opposition=0.95)
        mechanics.drive.squeeze[..., 3:] = 0.05 * np.arange(6)[:, None]  # N m
        y = mechanics.start()
        states, counted = solved(mechanics, y, 5)
        found, exact = forces(mechanics, states), forces(mechanics, radau(mechanics, y, 5))
        index, thumb = (exact[0, -1, mechanics.hands.patch // 3 == finger].sum() for finger in (3, 4))
        stiff = lambda_h(mechanics, states)
        said = f"index {index:.3g} N, thumb {thumb:.3g} N; {counted}"
        yield Finding(f"forces against Radau's, {stiff}", off(found, exact), TOLERANCE, said)


def damping(subject: Subject) -> Iterator[Finding]:
    """None is refused; with next to none the hand is always where the springs balance.

    An angle is right where its torque is off by no more than Newton's goal, 0.2 TOLERANCE of the least force counted,
    and the damping's own torque behind a posture that moves; the object is wanted at one place.
    """
    for name, given in (("joints", (0.0, 60.0)), ("object", (0.02, 0.0))):
        what = f"no damping of the {name}"
        yield refusal(what, lambda given=given: Layer(2.5e7, 4e-3, *given), "damping is 0.0; expected more than 0")
    for smallness in (1e-3, 1e-6, 1e-9):
        layer = Layer(2.5e7, DEFAULT.thickness, DEFAULT.joint_damping * smallness, DEFAULT.object_damping * smallness)
        mechanics = held([BALL], [[0.08, 0, 0.3]], HALF_CLOSED, layer=layer, knots=5, squeeze=0.1, load=(0, 0, -3.0))
        mechanics.drive.posture[0] += 0.2 * np.sin(np.arange(5))[:, None, None]
        states, counted = solved(mechanics, mechanics.start(), 4)
        exact = mechanics.drive.posture[0, 1:] + 0.1 * TENDON / JOINT
        torque = np.abs(states[0, :, :10].reshape(4, 5, 2) - exact).max(axis=(0, 1)) * JOINT
        goal = 0.2 * TOLERANCE * FLOOR * LEVER
        lag = 0.2 / FRAME * layer.joint_damping  # N m: behind a posture that moves
        stiff = lambda_h(mechanics, states)
        said = f"{counted}"
        yield Finding(f"torque that is not balanced, N m, {stiff}", float(torque.max()), goal + lag, said)
        force = HOLDING * np.abs(states[0, :, 12] - (0.3 - 3.0 / HOLDING)).max()
        yield Finding(f"force that is not balanced, N, {stiff}", float(force), 0.2 * TOLERANCE * FLOOR, said)


def deep_at_first(subject: Subject) -> Iterator[Finding]:
    """An object inside the palm is refused; fingers inside an object come out to where short steps and Radau do."""
    sunk = held([BALL], [[0.05, 0.0, 0.03]], HALF_CLOSED)
    yield refusal("a ball inside the palm", sunk.start, r"starts .* mm inside the palm; expected it outside")
    for setting in GRASPS[3:6]:
        layer = Layer(setting[0], DEFAULT.thickness, *setting[2:])
        mechanics = held([BALL], [BALL_AT], HALF_CLOSED, layer=layer, stiffness=setting[1], knots=7, opposition=0.9)
        y = mechanics.start()
        y[:, :10] = 1.2
        at = mechanics.balance(np.zeros(1, dtype=int), np.zeros(1), y, palm=True)
        states, counted = solved(mechanics, y, 6)
        stiff = lambda_h(mechanics, states)
        said = f"{at.contacts.depth.max() * 1e3:.3g} mm deep; {counted}"
        yield Finding(f"states that are not finite, {stiff}", finite(states), 0.0, said)
        error = off(forces(mechanics, states)[:, -1], forces(mechanics, radau(mechanics, y, 6))[:, -1])
        yield Finding(f"forces at the end against Radau's, {stiff}", error, TOLERANCE, said)


def a_hundred_thousand_frames(subject: Subject) -> Iterator[Finding]:
    """100 hands grasp 50 times in 1,000 frames, in steps of a whole one: the last grasp is the second one again.

    The first had another start. With steps that follow the tolerance, this takes five times as long.
    """
    mechanics, period = repeated_grasp(hands=100, grasps=50)
    states, counted = solved(mechanics, mechanics.start(), 50 * period, step=FRAME)
    yield Finding("states that are not finite", finite(states), 0.0, counted)
    last, early = states[:, -period:], states[:, period : 2 * period]
    apart = np.abs(last - early).max(axis=(0, 1))
    drift = max(apart[:10].max() * LEVER, apart[10:].max()) / DEFAULT.thickness
    yield Finding(
        "states of the last grasp against the second's", float(drift), TOLERANCE, f"in thicknesses; {counted}"
    )


def energy_never_grows(subject: Subject) -> Iterator[Finding]:
    """The drive stands still, so U - drive . y can only fall, from six starts each, some of them deep in the ball.

    What Newton leaves of a stage's forces, 0.2 TOLERANCE of them, may do work on the way: so much of the fall is right.
    """
    rng = np.random.default_rng(0)
    y = np.concatenate([rng.uniform(0, 1.2, (6, 10)), BALL_AT + rng.normal(0, 0.005, (6, 3)) + [0, 0, 0.01]], axis=1)
    for setting in GRASPS[2:8]:
        mechanics = held(
            [BALL], [BALL_AT] * 6, HALF_CLOSED, layer=Layer(setting[0], DEFAULT.thickness, *setting[2:]),
            stiffness=setting[1], knots=7, squeeze=0.1, opposition=0.9, load=(0.1, -0.2, -0.5),
        )  # fmt: skip
        states, counted = solved(mechanics, y, 6)
        energy = energies(mechanics, y, states)
        rise = np.diff(energy, axis=1).max(axis=1).clip(min=0) / (energy[:, 0] - energy[:, -1])
        stiff = lambda_h(mechanics, states)
        said = f"falls by up to {np.ptp(energy, axis=1).max():.2g} J; {counted}"
        yield Finding(
            f"largest rise from frame to frame over the fall, {stiff}", float(rise.max()), 0.2 * TOLERANCE, said
        )


def steps_and_tolerances(subject: Subject) -> Iterator[Finding]:
    """What cannot be is refused; what is not solved is rejected, so that in the default layer no wrong step is kept."""
    mechanics = grasp(GRASPS[3], seed=SEED, frames=8)
    for name, value in (("step", 0.0), ("step", -0.1), ("tolerance", np.nan), ("tolerance", np.inf), ("frame", 0.0)):
        given = {"frame": FRAME} | {name: value}
        pattern = rf"{name} is {value}; expected more than 0"
        yield refusal(f"a {name} of {value}", lambda given=given: Implicit(mechanics, **given), pattern)
    integrator = Implicit(mechanics, FRAME, TOLERANCE)
    integrator.run(mechanics.start(), 8)
    work = integrator.work
    yield Finding("steps kept in spite of their error, default layer", work.forced, 0.0, f"{work}")


def lambda_h(mechanics, states: np.ndarray) -> str:
    """How stiff a scene was."""
    return f"lambda h = {stiffness(mechanics, states, FRAME):.1e}"


CASES = (
    stiffness_of_a_grasp,
    stiffness_of_a_plate,
    steps_of_a_whole_frame,
    contact_within_a_step,
    fingers_stopped_by_a_rod,
    wedged_between_two_fingers,
    damping,
    deep_at_first,
    a_hundred_thousand_frames,
    energy_never_grows,
    steps_and_tolerances,
)
