"""Small scenes of the virtual glove, for tests: a flat bed of sensors, a drive that stands still, a short recipe."""

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.contact import Drive, Layer, Mechanics
from tactile_viewgcn.glove.hand import BASES, LINK_PATCHES, LINKS, Hand, Hands, Pose, stag_hand
from tactile_viewgcn.glove.objects import THINGS, Thing, choose
from tactile_viewgcn.glove.shapes import Solids
from tactile_viewgcn.glove.simulation import EFFECTS, Recipe

LAYER = Layer(stiffness=2e7, thickness=4e-3, joint_damping=0.02, object_damping=60.0)
OPEN_PALM = np.zeros((5, 2))
KNOWN = {thing.name: thing for thing in THINGS}
HELD = [KNOWN[name] for name in ("ball", "mug", "chain", "empty_hand", "tea_box", "safety_glasses")]
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


def still(place, *, posture=OPEN_PALM, squeeze=0.0, opposition=0.3, turn=(0.0, 0.0, 0.0), load=0.0, knots=2) -> Drive:
    """The same at every knot, for objects wanted at `place` (B, 3)."""
    place = np.atleast_2d(np.asarray(place, dtype=float))
    shapes = {"posture": (5, 2), "squeeze": (5,), "opposition": (), "place": (3,), "turn": (3,), "load": (3,)}
    given = {
        "posture": posture, "squeeze": squeeze, "opposition": opposition, "place": place[:, None],
        "turn": turn, "load": load,
    }  # fmt: skip
    size = len(place), knots
    return Drive(
        **{name: np.broadcast_to(given[name], (*size, *shape)).astype(float) for name, shape in shapes.items()}
    )


def solids(*things: Thing) -> Solids:
    """What the things are made of, one union each."""
    return Solids([list(thing.parts) for thing in things])


def gripping(*, motion: bool, seed: int = 0) -> tuple[Mechanics, np.ndarray]:
    """Half-closed fingers around the things of HELD, which are pressed a little into the palm, and the state (B, n)."""
    rng = np.random.default_rng(seed)
    turns = [Rotation.from_rotvec(rng.normal(0, 0.2, 3)) * Rotation.from_rotvec(thing.lie) for thing in HELD]
    down, count = np.array([0.0, 0.0, -1.0]), len(HELD)
    height = np.array([thing.extent(turn.as_matrix(), down) for thing, turn in zip(HELD, turns, strict=True)])
    place = np.stack([np.full(count, 0.07), rng.normal(0, 0.004, count), height - 0.001], axis=1)
    q = rng.uniform(0.5, 1.3, (count, 5, 2))
    q[0, 3] = 1.75, 2.0  # beyond the joints' limits
    turn = np.stack([turn.as_rotvec() for turn in turns])[:, None]
    drive = still(place, posture=q[:, None] - 0.1, squeeze=0.1, opposition=0.9, turn=turn, load=(0.1, -0.2, -0.5))
    stiffness = np.array([thing.stiffness for thing in HELD])
    hands = Hands([stag_hand(**fit) for fit in FITS])
    mechanics = Mechanics(hands, solids(*HELD), stiffness, drive, LAYER, motion=motion)
    y = q.reshape(count, 10)
    return mechanics, np.concatenate([y, place + rng.normal(0, 3e-4, place.shape)], axis=1) if motion else y


def points(hand: Hand, pose: Pose, row: int) -> np.ndarray:
    """(S, 3) m: where the sensors of one hand are, looked up one by one."""
    places = [pose.origin[row, n] + pose.axes[row, n] @ own for n, own in zip(hand.patch, hand.local, strict=True)]
    return np.array(places)


def recipe(objects=("ball", "coin"), *, without=(), **changes) -> Recipe:
    """Two sessions of one grasp of 18 frames, all effects but those in `without`."""
    things = choose(list(objects)) if not isinstance(objects, str) else choose(objects)
    given = {"sessions": 2, "frames": 18, "grasps": 1, "seed": 0, "layer": LAYER}
    return Recipe(things, effects=frozenset(EFFECTS) - set(without), **(given | changes))
