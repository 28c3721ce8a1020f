"""Small scenes of the virtual glove: a flat bed of sensors, a constant drive, gripping hands, a short recipe."""

from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.contact import Drive, Layer, Mechanics
from tactile_viewgcn.glove.hand import BASES, LINK_PATCHES, LINKS, Hand, Hands, Pose, stag_hand
from tactile_viewgcn.glove.objects import OBJECTS, GraspObject, select_objects
from tactile_viewgcn.glove.recipe import EFFECTS, Recipe
from tactile_viewgcn.glove.shapes import Solids, sphere
from tactile_viewgcn.glove.simulation import Simulation

FRAME = 0.1  # s
BALL_RADIUS = 0.1  # m
BALL = GraspObject("ball", 1, 1e12, (sphere(BALL_RADIUS),))
UNITS = np.array([0.05] * 10 + [1.0] * 3)  # m per rad and per m: makes errors of joints and positions comparable
LAYER = Layer(stiffness=2e7, thickness=4e-3, joint_damping=0.02, object_damping=60.0)
OPEN_PALM = np.zeros((5, 2))
OBJECTS_BY_NAME = {one.name: one for one in OBJECTS}
HELD = [OBJECTS_BY_NAME[name] for name in ("ball", "mug", "chain", "empty_hand", "tea_box", "safety_glasses")]
FITS = [{}, {"scale": 1.03}, {"slip": (0.002, -0.001)}, {}, {"scale": 0.97}, {}]  # of the hands that hold them


def bed(count: int, width: float, *, tiles: int = 4) -> Hand:
    """A flat palm of count x count sensors that fill a square about the origin, z up; its fingers feel nothing."""
    pitch = width / count
    row, column = np.mgrid[:count, :count].reshape(2, -1)
    patch = LINK_PATCHES + row * tiles // count * tiles + column * tiles // count
    order = np.argsort(patch, kind="stable")
    row, column, patch = row[order], column[order], patch[order]
    middle = (count - 1) / 2
    local = np.stack([(column - middle) * pitch, (row - middle) * pitch, np.zeros(len(row))], axis=1)
    normal = np.tile([0.0, 0.0, 1.0], (len(row), 1))
    return Hand(row, column, patch, local, normal, np.full(len(row), pitch**2), BASES, LINKS)


def constant_drive(
    position, *, posture=OPEN_PALM, squeeze=0.0, opposition=0.3, rotation=(0.0, 0.0, 0.0), load=0.0, knots=2
) -> Drive:
    """A drive that is the same at every knot, for objects at `position` (B, 3)."""
    position = np.atleast_2d(np.asarray(position, dtype=float))
    shapes = {"posture": (5, 2), "squeeze": (5,), "opposition": (), "position": (3,), "rotation": (3,), "load": (3,)}
    values = {
        "posture": posture, "squeeze": squeeze, "opposition": opposition, "position": position[:, None],
        "rotation": rotation, "load": load,
    }  # fmt: skip
    size = len(position), knots
    return Drive(
        **{name: np.broadcast_to(values[name], (*size, *shape)).astype(float) for name, shape in shapes.items()}
    )


def solids(*objects: GraspObject) -> Solids:
    """One union for each object."""
    return Solids([list(one.parts) for one in objects])


def gripping_hands(*, motion: bool, seed: int = 0) -> tuple[Mechanics, np.ndarray]:
    """Half-closed fingers around the objects of HELD, pressed a little into the palm, and their state (B, n)."""
    rng = np.random.default_rng(seed)
    rotations = [Rotation.from_rotvec(rng.normal(0, 0.2, 3)) * Rotation.from_rotvec(held.orientation) for held in HELD]
    count = len(HELD)
    height = np.array([held.lowest(one.as_matrix()) for held, one in zip(HELD, rotations, strict=True)])
    position = np.stack([np.full(count, 0.07), rng.normal(0, 0.004, count), height - 0.001], axis=1)
    q = rng.uniform(0.5, 1.3, (count, 5, 2))
    q[0, 3] = 1.75, 2.0  # beyond the joints' limits
    rotation = np.stack([one.as_rotvec() for one in rotations])[:, None]
    drive = constant_drive(
        position, posture=q[:, None] - 0.1, squeeze=0.1, opposition=0.9, rotation=rotation, load=(0.1, -0.2, -0.5)
    )
    stiffness = np.array([held.stiffness for held in HELD])
    hands = Hands([stag_hand(**fit) for fit in FITS])
    mechanics = Mechanics(hands, solids(*HELD), stiffness, drive, LAYER, motion=motion)
    y = q.reshape(count, 10)
    return mechanics, np.concatenate([y, position + rng.normal(0, 3e-4, position.shape)], axis=1) if motion else y


def sphere_on_bed() -> tuple[Mechanics, np.ndarray]:
    """A sphere that stays in contact with all of a small bed's sensors while it moves, and its state (1, 13)."""
    layer = replace(LAYER, stiffness=1e6)
    position = [0.002, 0.001, BALL_RADIUS - 0.001]
    drive = constant_drive(position, load=(0, 0, -3.0), posture=np.full((5, 2), 0.3), squeeze=0.05)
    mechanics = Mechanics(Hands([bed(4, 0.01)]), solids(BALL), np.array([1e12]), drive, layer, motion=True)
    return mechanics, np.array([[0.1] * 10 + [0, 0, BALL_RADIUS - 0.003]])


def free_finger(drive: Drive | None = None, **layer: float) -> Mechanics:
    """Fingers and an object's position without any contact."""
    drive = drive or constant_drive([0, 0, 0.5], posture=np.full((5, 2), 0.3))
    hands = Hands([bed(4, 0.01)])
    return Mechanics(hands, solids(OBJECTS[0]), np.array([1e9]), drive, replace(LAYER, **layer), motion=True)


def radau(mechanics: Mechanics, y: np.ndarray) -> np.ndarray:
    """The state (n,) of the first hand a frame after y (1, n), by SciPy."""
    row = np.zeros(1, dtype=int)

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        balance = mechanics.evaluate(row, np.array([time / FRAME]), state[None], palm=True)
        return -balance.residual[0] / mechanics.damping

    return solve_ivp(slope, (0, FRAME), y[0], method="Radau", rtol=1e-9, atol=1e-12).y[:, -1]


def error_of_state(y: np.ndarray, exact: np.ndarray) -> float:
    """Largest difference of two states (13,), m; angles are measured at a lever of 5 cm."""
    return float(np.max(np.abs(y - exact) * UNITS))


def points(hand: Hand, pose: Pose, row: int) -> np.ndarray:
    """Positions (S, 3) m of the sensors of one hand, computed one by one."""
    sensors = zip(hand.patch, hand.local, strict=True)
    return np.array([pose.origin[row, n] + pose.axes[row, n] @ local for n, local in sensors])


def recipe(objects=("ball", "coin"), *, without=(), **changes) -> Recipe:
    """Two sessions of one grasp, 22 frames, all effects but those in `without`."""
    defaults = {"sessions": 2, "frames": 22, "grasps": 1, "seed": 0, "layer": LAYER}
    return Recipe(select_objects(list(objects)), effects=frozenset(EFFECTS) - set(without), **(defaults | changes))


def simulated_counts(recipe: Recipe) -> tuple[np.ndarray, Simulation]:
    """Counts (B, T, S) of all recordings of a recipe, and the simulation."""
    run = Simulation(recipe)
    hand = stag_hand()
    return np.concatenate(list(run.blocks()), axis=1)[..., hand.row, hand.column], run
