"""Small scenes of the virtual glove whose end is known, or which SciPy's Radau solves quickly."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.solver.other_integrators import integrate_with_scipy
from benchmarks.solver.scenes import THICKNESS, ball_grasp, stiffness
from tactile_viewgcn.glove.hand import BASES, LINK_PATCHES, LINKS, USUAL, Hands, Pose, stag_hands
from tactile_viewgcn.glove.mechanics import HOLDING, Drive, Layer, Mechanics
from tactile_viewgcn.glove.objects import OBJECTS, select_objects
from tactile_viewgcn.glove.scene import OPEN
from tactile_viewgcn.glove.shapes import Primitive, Solids, box, capsule, sphere
from tactile_viewgcn.glove.simulation import EFFECTS, Recipe, Simulation

RATE = 7.35  # frames a second, as in STAG's data
FRAME = 1 / RATE  # s
LAYER = Layer(2.5e7, THICKNESS, 0.02, 60.0)
# settings of a grasp, one for each decade of lambda h: stiffness of skin and object, Pa/m;
# damping of the joints, N m s/rad, and of the object, N s/m
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
# m: a ball above the palm, so that only fingers touch it at first
BALL = sphere(0.034)
BALL_AT = (0.075, 0.0, 0.037)
TILES = 4  # patches of a bed along each side
SPHERE_RADIUS = 0.1  # m, of the sphere on a bed
RTOL = 1e-6  # Radau's tolerance
MAX_EVALUATIONS = 60_000  # Radau's largest number of evaluations
FLAT = (0.08, 0.04, 0.03)  # m: a plate that lies on the palm between the fingers and the thumb
MIDDLE = 0.02  # m: the x of the plate
FIRM = 15_000.0  # N/m: the least stiffness of the plate's sensors together
# m by which the plate sinks in at most: the sensors beside the two rows are 0.5 mm lower
SUNK = 2e-4
OBJECTS_BY_NAME = {grasp_object.name: grasp_object for grasp_object in OBJECTS}
GRIPPED = [
    OBJECTS_BY_NAME[name]
    for name in ("ball", "mug", "chain", "empty_hand", "tea_box", "safety_glasses")
]
# fits of the hands that grip them
FITS = [USUAL, (1.03, (0, 0)), (1.0, (0.002, -0.001)), USUAL, (0.97, (0, 0)), USUAL]


def bed(count: int, width: float, *, hands: int = 1) -> Hands:
    """Return flat palms of count x count sensors that fill a square about the origin, with z up.

    The fingers have no sensors.
    """
    pitch = width / count
    row, column = np.mgrid[:count, :count].reshape(2, -1)
    patch = LINK_PATCHES + row * TILES // count * TILES + column * TILES // count
    order = np.argsort(patch, kind="stable")
    row = row[order]
    column = column[order]
    patch = patch[order]
    middle = (count - 1) / 2
    local = np.stack(
        [(column - middle) * pitch, (row - middle) * pitch, np.zeros(len(row))], axis=1
    )
    normal = np.tile([0.0, 0.0, 1.0], (len(row), 1))
    area = np.full(len(row), pitch**2)
    repeated = [np.stack([values] * hands) for values in (local, normal, area, BASES, LINKS)]
    return Hands(row, column, patch, *repeated)


def scene(
    parts: list[list[Primitive]],
    position,
    *,
    posture=0.0,
    hands: Hands | None = None,
    stiffness=2e7,
    layer=LAYER,
    motion=True,
    knots=2,
    squeeze=0.0,
    opposition=0.3,
    rotation=(0.0, 0.0, 0.0),
    load=(0.0, 0.0, 0.0),
) -> Mechanics:
    """Return the mechanics of B hands around objects, with the same drive at all knots.

    B is the number of positions (B, 3) m. `parts` has one union for all hands, or one for each.
    Without `hands` the hands are STAG's.
    """
    position = np.atleast_2d(np.asarray(position, dtype=float))
    count = len(position)
    shapes = {
        "posture": (5, 2),
        "squeeze": (5,),
        "opposition": (),
        "position": (3,),
        "rotation": (3,),
        "load": (3,),
    }
    values = {
        "posture": posture,
        "squeeze": squeeze,
        "opposition": opposition,
        "position": position[:, None],
        "rotation": rotation,
        "load": load,
    }
    at_knots = {
        name: np.broadcast_to(values[name], (count, knots, *size)).astype(float)
        for name, size in shapes.items()
    }
    unions = [list(primitives) for primitives in parts]
    if len(unions) == 1:
        unions = unions * count
    if hands is None:
        hands = stag_hands(*[USUAL] * count)
    stiffness = np.broadcast_to(np.asarray(stiffness, dtype=float), count)
    return Mechanics(hands, Solids(unions), stiffness, Drive(**at_knots), layer, motion=motion)


def gripping_hands(*, motion: bool, seed: int = 0) -> tuple[Mechanics, np.ndarray]:
    """Return half-closed fingers around the objects of GRIPPED, and their state (B, n).

    The objects are pressed a little into the palm.
    """
    rng = np.random.default_rng(seed)
    count = len(GRIPPED)
    rotations = []
    heights = []
    for grasp_object in GRIPPED:
        tilt = Rotation.from_rotvec(rng.normal(0, 0.2, 3))
        rotation = tilt * Rotation.from_rotvec(grasp_object.orientation)
        rotations.append(rotation.as_rotvec())
        heights.append(grasp_object.lowest(rotation.as_matrix()) - 0.001)
    position = np.stack([np.full(count, 0.07), rng.normal(0, 0.004, count), heights], axis=1)
    q = rng.uniform(0.5, 1.3, (count, 5, 2))
    q[0, 3] = [1.75, 2.0]  # beyond the joints' limits
    mechanics = scene(
        [grasp_object.parts for grasp_object in GRIPPED],
        position,
        posture=q[:, None] - 0.1,
        hands=stag_hands(*FITS),
        stiffness=[grasp_object.stiffness for grasp_object in GRIPPED],
        motion=motion,
        squeeze=0.1,
        opposition=0.9,
        rotation=np.stack(rotations)[:, None],
        load=(0.1, -0.2, -0.5),
    )
    y = q.reshape(count, 10)
    if motion:
        moved = position + rng.normal(0, 3e-4, position.shape)
        y = np.concatenate([y, moved], axis=1)
    return mechanics, y


def sphere_on_bed() -> tuple[Mechanics, np.ndarray]:
    """Return a sphere on a small bed, and its state (1, 13).

    The sphere stays in contact with all sensors of the bed while it moves.
    """
    mechanics = scene(
        [[sphere(SPHERE_RADIUS)]],
        [0.002, 0.001, SPHERE_RADIUS - 0.001],
        posture=0.3,
        hands=bed(4, 0.01),
        stiffness=1e12,
        layer=replace(LAYER, stiffness=1e6),
        load=(0, 0, -3.0),
        squeeze=0.05,
    )
    return mechanics, np.array([[0.1] * 10 + [0, 0, SPHERE_RADIUS - 0.003]])


def free_finger(*, posture=0.3, squeeze=0.0, knots=2, **layer: float) -> Mechanics:
    """Return fingers and an object without any contact."""
    layer = replace(LAYER, **layer)
    return scene(
        [[]],
        [0, 0, 0.5],
        posture=posture,
        hands=bed(4, 0.01),
        layer=layer,
        squeeze=squeeze,
        knots=knots,
    )


def rod(damping: float) -> Mechanics:
    """Return fingers that would close behind a rod within a frame; `damping` is in N m s/rad."""
    across = capsule(0.012, 0.2, rotation=(np.pi / 2, 0, 0))
    layer = replace(LAYER, joint_damping=damping)
    mechanics = scene([[across]], [0.105, 0, 0.05], posture=0.1, layer=layer, knots=3, motion=False)
    mechanics.drive.posture[0, 2:] = 1.5
    return mechanics


def skin(setting: tuple[float, float, float, float]) -> Layer:
    """Return the layer of one of GRASPS."""
    return Layer(setting[0], THICKNESS, *setting[2:])


def lambda_h(mechanics: Mechanics, states: np.ndarray) -> str:
    """Return a text that says how stiff a scene was."""
    return f"lambda h = {stiffness(mechanics, states, FRAME):.1e}"


def around_a_ball(setting: tuple[float, float, float, float], posture, **drive) -> Mechanics:
    """Return a hand around a ball above the palm, with stiffness and damping from one of GRASPS."""
    options = {
        "posture": posture,
        "layer": skin(setting),
        "stiffness": setting[1],
        "opposition": 0.9,
    }
    return scene([[BALL]], BALL_AT, **options, **drive)


def grasp(setting: tuple[float, float, float, float], *, seed: int, frames: int) -> Mechanics:
    """Return a grasp of a ball from the moment when the fingers begin to close.

    The ball is in place then, and the hand is open.
    """
    return ball_grasp(*setting, seed=seed).mechanics(9, 9 + frames)


def forces(mechanics: Mechanics, states: np.ndarray) -> np.ndarray:
    """Return the forces (B, T, S) N on sensors at states (B, T, n), whichever way they face."""
    hands, frames, _ = states.shape
    rows = np.arange(hands)
    total = np.zeros((hands, frames, len(mechanics.hands.patch)))
    for t in range(frames):
        balance = mechanics.evaluate(rows, np.full(hands, t + 1.0), states[:, t], palm=True)
        np.add.at(total[:, t], (balance.contacts.row, balance.contacts.sensor), balance.force)
    return total


def radau(
    mechanics: Mechanics, y: np.ndarray, frames: int, *, frame: float = FRAME, rtol: float = RTOL
) -> np.ndarray:
    """Return states (1, frames, n) of the first hand from y (1, n), by Radau."""
    states, _ = integrate_with_scipy(
        "Radau", mechanics, 0, y[0], frames, frame, rtol=rtol, max_evaluations=MAX_EVALUATIONS
    )
    return states[None]


def rel_norm_error(values: np.ndarray, exact: np.ndarray) -> float:
    """Return the norm of the difference over the norm of the exact values.

    The norms are over frames and sensors. The result is NaN if the exact values are 0.
    """
    return float(np.linalg.norm(values - exact) / np.linalg.norm(exact))


def plate(lambda_h: float, *, frames: int) -> tuple[Mechanics, np.ndarray, np.ndarray]:
    """Return a plate on two rows of the palm's sensors, whose load changes from frame to frame.

    As long as the same sensors carry it, its equation is linear: D dd/dt = f(t) - K d for the depth
    d. Between the frames f is linear, so d has a closed form.

    Returns:
        The mechanics, the state (1, 13) at first, and the exact forces (1, frames, S) N on the
            sensors.
    """
    hand = stag_hands()
    x, y, z = hand.local[0].T
    area = hand.area[0]
    across = np.abs(y)  # m from the middle of the plate
    on_palm = hand.patch >= LINK_PATCHES
    below = on_palm & (np.abs(x - MIDDLE) < FLAT[0] / 2) & (across < FLAT[1] / 2)
    carry = below & (across > across[below].max() - 1e-6)
    damping = max(2.0, (FIRM + HOLDING) * FRAME / lambda_h)  # N s/m
    whole = damping * lambda_h / FRAME  # N/m: sensors and holding
    per_area = (whole - HOLDING) / area[carry].sum()
    height = z[carry].mean() + FLAT[2] / 2
    # Layer and plate are in series, so together they are half as stiff as each. The open fingers
    # are not stiffer than the plate.
    layer = Layer(2 * per_area, THICKNESS, max(LAYER.joint_damping, FRAME / lambda_h), damping)
    place = [MIDDLE, 0, height]
    mechanics = scene(
        [[box(*FLAT)]],
        place,
        posture=OPEN - 0.2,
        layer=layer,
        stiffness=2 * per_area,
        knots=frames + 1,
    )
    load = min(8.0, 1.5 * SUNK * whole) * np.where(np.arange(frames + 1) % 2, 1.0, 0.5)  # N
    mechanics.drive.load[0, :, 2] = -load
    depth = load[1] / whole
    start = mechanics.drive.position[:, 0] - [0, 0, depth]
    state = np.concatenate([mechanics.drive.posture[:, 0].reshape(1, 10), start], axis=1)
    decay = np.exp(-FRAME * whole / damping)
    depths = []
    for begin, end in pairwise(load):
        lag = (end - begin) / FRAME * damping / whole
        depth = (end - lag) / whole + (depth - (begin - lag) / whole) * decay
        depths.append(depth)
    force = np.array(depths)[:, None] * np.where(carry, per_area * area, 0.0)
    return mechanics, state, force[None]


def points(hands: Hands, hand: int, pose: Pose, row: int) -> np.ndarray:
    """Return the positions (S, 3) m of the sensors of one hand, computed one by one.

    The hand is a row of the pose.
    """
    sensors = zip(hands.patch, hands.local[hand], strict=True)
    positions = [
        pose.origin[row, patch] + pose.axes[row, patch] @ local for patch, local in sensors
    ]
    return np.array(positions)


def recipe(objects=("ball", "coin"), *, without=(), **changes) -> Recipe:
    """Return two sessions of one grasp, 22 frames, with all effects except those in `without`."""
    defaults = {"sessions": 2, "frames": 22, "grasps": 1, "seed": 0, "layer": LAYER}
    return Recipe(
        select_objects(list(objects)),
        effects=frozenset(EFFECTS) - set(without),
        **(defaults | changes),
    )


def simulated_counts(recipe: Recipe) -> tuple[np.ndarray, Simulation]:
    """Return the counts (B, T, S) of all recordings of a recipe, and the simulation."""
    run = Simulation(recipe)
    frames = np.concatenate(list(run.blocks()), axis=1)
    return frames[..., run.hands.row, run.hands.column], run
