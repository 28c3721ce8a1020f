"""Scenes: the prescribed motion of a recording, from the object and the hand to every squeeze, shift and release.

A recording is one long manipulation. It begins with the open hand; then the object is grasped again
and again. In each grasp the object arrives, the fingers close until they touch it, squeeze it more
the heavier it is, hold it while it moves a little, and let go without opening wholly. The numbers
below belong to the calibrated constants, see VERSION in `simulation.py`.
"""

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.contact import GRAVITY, Drive, collisions
from tactile_viewgcn.glove.hand import Hands
from tactile_viewgcn.glove.objects import GraspObject
from tactile_viewgcn.glove.shapes import Solids

# rad: posture of an open and of a closed finger
OPEN, CLOSED = np.array([0.15, 0.15]), np.array([1.35, 1.45])
# closure, 0 open to 1 closed: of a finger that touches nothing; of an empty hand
RELAXED, IDLE = 0.4, 0.2
ASIDE = 0.3  # rad: the thumb's opposition while the hand is open
AWAY = 0.03  # m above its position in the grasp: the object before and after a grasp
# m: where an object lies against the palm, its lower side at z
POWER = np.array([0.080, 0.002, 0.001])
PINCH = np.array([0.080, 0.018, 0.070])  # m: where the fingertips meet the thumb's
DIP = 0.001  # m by which the prescribed position may press an object into the palm
CORRELATION = 0.7  # of a drifting grip, from frame to frame
CLOSURES = 28  # closures at which a finger is tested for contact
#: standard deviations: of an object from the next, of a recording, of a grasp, and within a grasp
# m, of the object
POSITION = {"object": 0.008, "recording": 0.001, "grasp": 0.010, "within": 0.005}
ROTATION = {"object": 0.35, "recording": 0.05, "grasp": 0.6, "within": 0.25}  # rad, of the object
# of the logarithm of a finger's squeeze
FINGER = {"object": 0.6, "recording": 0.08, "grasp": 0.8, "within": 0.45}
THUMB = {"object": 0.12, "recording": 0.05, "grasp": 0.2}  # rad, of the opposition
OPPOSITION = 0.95  # rad
ROLL = 0.6  # rad, of a grasp, about the object's axis, beside half a turn in every second one
PINCHED = 0.3  # share of these deviations that an object between the fingertips has
SQUEEZE = (0.04, 0.60)  # N m of a weightless object, and N m per kg of weight
OPENING = 8  # frames of the open hand before the first grasp
# frames; `hold` fills the grasp
PHASES = {"arrive": 1, "close": 4, "squeeze": 2, "hold": 0, "release": 2}
HOLD = list(PHASES).index("hold")  # number of the steady phase
LOOSE = 0.4  # share of the next grasp's closure that a hand keeps between two grasps


def plan(
    grasp_objects: list[GraspObject], hands: Hands, solids: Solids, habits: list[np.random.Generator],
    rngs: list[np.random.Generator], *, frames: int, grasps: int, effects: frozenset[str],
) -> Drive:  # fmt: skip
    """Drive of B recordings at T + 1 knots, each drawn from its own generator; frame t ends at knot t + 1."""
    phase, progress, grasp = schedule(frames, grasps)
    drawn = [_draw(*each, grasps) for each in zip(grasp_objects, habits, rngs, strict=True)]
    grips = [np.stack(values) for values in zip(*drawn, strict=True)]  # (B, G, ...) each
    closed = np.stack(
        [closure(hands, solids, *(one[:, g] for one in grips[:3])) for g in range(grasps)], axis=1
    )
    position, rotation, opposition, squeeze = (one[:, grasp] for one in grips)
    # (T,) each, 0 to 1: the object has arrived, the fingers have closed, they squeeze.
    arrive, close, squeezing, hold, release = (phase == number for number in range(len(PHASES)))
    near = np.select([phase < 0, arrive, release], [0, progress, 1 - progress], 1.0)
    tightening = np.select([phase <= 0, close, release], [0, progress, 1 - progress], 1.0)
    closing = np.where(phase < 0, 0, LOOSE + (1 - LOOSE) * tightening)
    loaded = np.select(
        [squeezing, hold, release], [progress, 1, np.maximum(1 - 2 * progress, 0)], 0.0
    )
    noise = np.stack([rng.normal(size=(frames, 11)) for rng in rngs])
    noise[:, 1:] *= np.sqrt(1 - CORRELATION**2)
    # autoregressive, of order 1 and unit variance
    drift = lfilter([1.0], [1.0, -CORRELATION], noise, axis=1)
    squeeze *= loaded[:, None]
    if "shift" in effects:
        moved = loaded[:, None] * np.array([_freedom(one) for one in grasp_objects])[:, None, None]
        position += POSITION["within"] * moved * drift[..., :3]
        rotation += ROTATION["within"] * moved * drift[..., 3:6]
    if "tremor" in effects:
        squeeze *= np.exp(FINGER["within"] * drift[..., 6:])
    position[..., 2] += AWAY * (1 - near)
    posture = OPEN + (closing[:, None] * closed[:, grasp])[..., None] * (CLOSED - OPEN)
    load = np.zeros((len(grasp_objects), frames, 3))
    if "weight" in effects:
        load[..., 2] = -1e-3 * GRAVITY * np.array([[one.weight] for one in grasp_objects]) * loaded
    opposition = ASIDE + (opposition - ASIDE) * near
    frames_of = (posture, squeeze, opposition, position, rotation, load)
    return Drive(*(np.concatenate([values[:, :1], values], axis=1) for values in frames_of))


def schedule(frames: int, grasps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number of the phase, progress of the phase at the frame's end (0 to 1), and number of the grasp, (T,) each.

    The open hand before the first grasp is phase -1. A grasp has more frames than the phases but
    `hold` need.
    """
    each, fixed = (frames - OPENING) // grasps, sum(PHASES.values())
    lengths = np.array([length or each - fixed for length in PHASES.values()])
    starts = np.concatenate([[0], np.cumsum(lengths)])
    inside = np.arange(frames) - (frames - grasps * each)  # before 0: the open hand
    grasp, inside = np.where(inside < 0, [[0], [-1]], np.divmod(inside, each))
    phase = np.searchsorted(starts, inside, side="right") - 1
    return phase, (inside + 1 - starts[phase]) / lengths[phase], grasp


def closure(
    hands: Hands, solids: Solids, position: np.ndarray, rotation: np.ndarray, opposition: np.ndarray
) -> np.ndarray:
    """Closure (B, 5), 0 open to 1 closed, at which each finger first touches the object of a grasp.

    Args:
        position: (B, 3) m of the objects; rotation: (B, 3) rad, their rotation vectors.
        opposition: (B,) rad of the thumbs.
    """
    count = len(position)
    rows, first = np.arange(count), np.full((count, 5), np.nan)
    matrix = Rotation.from_rotvec(rotation).as_matrix()
    for closed in np.linspace(0, 1, CLOSURES):
        q = np.broadcast_to(OPEN + closed * (CLOSED - OPEN), (count, 5, 2))
        pose = hands.pose(rows, q, opposition)
        contacts = collisions(hands, solids, rows, pose, position, matrix, palm=False)
        touches = np.zeros(first.shape, dtype=bool)
        touches[contacts.row, contacts.patch // 3] = True
        first[touches & np.isnan(first)] = closed
    empty = ~np.isfinite(solids.bounding_radius[:, :1]).any(axis=1, keepdims=True)
    return np.where(np.isnan(first), np.where(empty, IDLE, RELAXED), first)


def _draw(
    grasp_object: GraspObject, habit: np.random.Generator, rng: np.random.Generator, grasps: int
) -> tuple[np.ndarray, ...]:
    """Position (G, 3) m, rotation vector (G, 3) rad, opposition (G,) rad and squeeze (G, 5) N m of G grasps.

    Args:
        habit: draws the usual grasp of the object; rng: draws the deviations of a recording and of
            its grasps.
    """

    def spread(std: dict[str, float], size: int) -> np.ndarray:
        """Deviations (G, size) from what all objects have in common."""
        of_object, of_recording = (
            habit.normal(0, std["object"], size),
            rng.normal(0, std["recording"], size),
        )
        return _freedom(grasp_object) * (
            of_object + of_recording + rng.normal(0, std["grasp"], (grasps, size))
        )

    roll = rng.normal(0, ROLL, grasps) + np.pi * rng.integers(2, size=grasps)
    usual = Rotation.from_rotvec(grasp_object.orientation)
    rotation = (
        Rotation.from_rotvec(spread(ROTATION, 3))
        * usual
        * Rotation.from_rotvec(roll[:, None] * [0, 0, 1])
    )
    below = np.array([grasp_object.lowest(matrix) for matrix in rotation.as_matrix()])
    position = np.tile(PINCH if grasp_object.pinch else POWER, (grasps, 1))
    if not grasp_object.pinch:
        position[:, 2] += below
    position += spread(POSITION, 3) * [1, 1, 0.3]
    position[:, 2] = np.maximum(position[:, 2], below - DIP)
    opposition = np.clip(OPPOSITION + spread(THUMB, 1)[:, 0], ASIDE, 1.4)
    squeeze = (SQUEEZE[0] + SQUEEZE[1] * grasp_object.weight * 1e-3) * np.exp(spread(FINGER, 5))
    return position, rotation.as_rotvec(), opposition, squeeze


def _freedom(grasp_object: GraspObject) -> float:
    """Share of the deviations of a grasp: with more, fingertips would lose a thin object."""
    return PINCHED if grasp_object.pinch else 1.0
