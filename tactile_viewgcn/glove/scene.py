"""Scenes: the prescribed motion of a recording, with every squeeze, shift and release.

A recording is one long manipulation. It begins with the open hand; then the object is grasped again
and again. In each grasp the object arrives, and the fingers close until they touch it. They squeeze
it more the heavier it is, hold it while it moves a little, and let go without opening completely.
The constants below are calibrated, see VERSION in `simulation.py`.
"""

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.contact import collisions
from tactile_viewgcn.glove.hand import FINGERS, Hands, part_of
from tactile_viewgcn.glove.mechanics import Drive
from tactile_viewgcn.glove.objects import GraspObject
from tactile_viewgcn.glove.shapes import Solids

GRAVITY = 9.81  # m/s^2
OPEN = np.array([0.15, 0.15])  # rad: posture of an open finger
CLOSED = np.array([1.35, 1.45])  # rad: posture of a closed finger
RELAXED = 0.4  # closure, 0 open to 1 closed, of a finger that touches nothing
IDLE = 0.2  # closure of the fingers of an empty hand
ASIDE = 0.3  # rad: the thumb's opposition while the hand is open
AWAY = 0.03  # m by which the object is above its position in the grasp, before and after a grasp
# m: where an object lies against the palm, with its lower side at z
POWER = np.array([0.080, 0.002, 0.001])
PINCH = np.array([0.080, 0.018, 0.070])  # m: where the fingertips meet the thumb's
DIP = 0.001  # m by which the prescribed position may press an object into the palm
CORRELATION = 0.7  # correlation of the grip's drift from frame to frame
CLOSURES = 28  # number of closures at which a finger is tested for contact
# Standard deviations between objects, between recordings, between grasps, and within a grasp.
# m, of the object
POSITION = {"object": 0.008, "recording": 0.001, "grasp": 0.010, "within": 0.005}
ROTATION = {"object": 0.35, "recording": 0.05, "grasp": 0.6, "within": 0.25}  # rad, of the object
# of the logarithm of a finger's squeeze
FINGER = {"object": 0.6, "recording": 0.08, "grasp": 0.8, "within": 0.45}
THUMB = {"object": 0.12, "recording": 0.05, "grasp": 0.2}  # rad, of the opposition
OPPOSITION = 0.95  # rad
LARGEST_OPPOSITION = 1.4  # rad
ROLL = 0.6  # rad, of a grasp, about the object's axis; about half of the grasps turn by pi too
PINCHED = 0.3  # share of these deviations that an object between the fingertips has
SQUEEZE = (0.04, 0.60)  # N m for a weightless object, and N m per kg of weight
OPENING = 8  # frames of the open hand before the first grasp
# frames of each phase; `hold` takes the rest of the grasp
PHASES = {"arrive": 1, "close": 4, "squeeze": 2, "hold": 0, "release": 2}
HOLD = list(PHASES).index("hold")  # number of the phase in which the grasp is steady
LOOSE = 0.4  # share of the next grasp's closure that a hand keeps between two grasps


def plan(
    grasp_objects: list[GraspObject],
    hands: Hands,
    solids: Solids,
    habits: list[np.random.Generator],
    rngs: list[np.random.Generator],
    *,
    frames: int,
    grasps: int,
    effects: frozenset[str],
) -> Drive:
    """Return the drive of B recordings at T + 1 knots; frame t ends at knot t + 1.

    Args:
        grasp_objects: the B objects.
        hands: the B hands.
        solids: the B objects as solids.
        habits: B generators, which draw the usual grasp of each object.
        rngs: B generators, which draw the deviations of each recording from the usual grasp.
        frames: T, number of frames.
        grasps: number of grasps in a recording.
        effects: see `simulation.EFFECTS`.
    """
    phase, progress, grasp = schedule(frames, grasps)
    draws = [
        _draw(grasp_object, habit, rng, grasps)
        for grasp_object, habit, rng in zip(grasp_objects, habits, rngs, strict=True)
    ]
    # (B, G, ...) each
    position, rotation, opposition, squeeze = map(np.stack, zip(*draws, strict=True))
    closed = _closures(hands, solids, position, rotation, opposition)[:, grasp]
    # (B, T, ...) each
    position = position[:, grasp]
    rotation = rotation[:, grasp]
    opposition = opposition[:, grasp]
    squeeze = squeeze[:, grasp]
    near, closing, loaded = _courses(phase, progress)
    drift = np.stack([_drift(rng, frames) for rng in rngs])
    squeeze *= loaded[:, None]
    if "shift" in effects:
        freedom = np.array([_freedom(grasp_object) for grasp_object in grasp_objects])
        moved = loaded[:, None] * freedom[:, None, None]
        position += POSITION["within"] * moved * drift[..., :3]
        rotation += ROTATION["within"] * moved * drift[..., 3:6]
    if "tremor" in effects:
        squeeze *= np.exp(FINGER["within"] * drift[..., 6:])
    position[..., 2] += AWAY * (1 - near)
    posture = OPEN + (closing[:, None] * closed)[..., None] * (CLOSED - OPEN)
    load = np.zeros_like(position)
    if "weight" in effects:
        load[..., 2] = _weights(grasp_objects) * loaded
    opposition = ASIDE + (opposition - ASIDE) * near
    return Drive(
        posture=_with_first_knot(posture),
        squeeze=_with_first_knot(squeeze),
        opposition=_with_first_knot(opposition),
        position=_with_first_knot(position),
        rotation=_with_first_knot(rotation),
        load=_with_first_knot(load),
    )


def _weights(grasp_objects: list[GraspObject]) -> np.ndarray:
    """Return the force (B, 1) N of each object's weight along z."""
    grams = np.array([[grasp_object.weight] for grasp_object in grasp_objects])
    weights: np.ndarray = -1e-3 * GRAVITY * grams
    return weights


def _courses(phase: np.ndarray, progress: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return how far the object has arrived and the fingers have closed, and how hard they squeeze.

    Args:
        phase: (T,) see `schedule`.
        progress: (T,) see `schedule`.

    Returns:
        Three arrays (T,) from 0 to 1.
    """
    arrive, close, squeeze, hold, release = (phase == number for number in range(len(PHASES)))
    near = np.select([phase < 0, arrive, release], [0, progress, 1 - progress], 1.0)
    tightening = np.select([phase <= 0, close, release], [0, progress, 1 - progress], 1.0)
    closing = np.where(phase < 0, 0, LOOSE + (1 - LOOSE) * tightening)
    letting_go = np.maximum(1 - 2 * progress, 0)
    loaded = np.select([squeeze, hold, release], [progress, 1, letting_go], 0.0)
    return near, closing, loaded


def _drift(rng: np.random.Generator, frames: int) -> np.ndarray:
    """Return a recording's drift (T, 11), autoregressive of order 1 with unit variance."""
    noise = rng.normal(size=(frames, 11))
    noise[1:] *= np.sqrt(1 - CORRELATION**2)
    drift: np.ndarray = lfilter([1.0], [1.0, -CORRELATION], noise, axis=0)
    return drift


def _with_first_knot(values: np.ndarray) -> np.ndarray:
    """Return values (B, T + 1, ...) at the knots: the first knot has the values of the second."""
    return np.concatenate([values[:, :1], values], axis=1)


def schedule(frames: int, grasps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the phase, its progress and the grasp of each frame.

    Args:
        frames: T, number of frames.
        grasps: number of grasps. Each has more frames than all phases but `hold` need.

    Returns:
        Three arrays (T,): the number of the phase, or -1 for the open hand before the first grasp;
        the progress of the phase at the frame's end, from 0 to 1; and the number of the grasp.
    """
    grasp_frames = (frames - OPENING) // grasps
    hold = grasp_frames - sum(PHASES.values())
    lengths = np.array([length or hold for length in PHASES.values()])
    starts = np.concatenate([[0], np.cumsum(lengths)])
    since_first_grasp = np.arange(frames) - (frames - grasps * grasp_frames)
    is_before = since_first_grasp < 0
    grasp = np.where(is_before, 0, since_first_grasp // grasp_frames)
    frame = np.where(is_before, -1, since_first_grasp % grasp_frames)  # number in the grasp
    phase = np.searchsorted(starts, frame, side="right") - 1
    progress = (frame + 1 - starts[phase]) / lengths[phase]
    return phase, progress, grasp


def closure(
    hands: Hands, solids: Solids, position: np.ndarray, rotation: np.ndarray, opposition: np.ndarray
) -> np.ndarray:
    """Return the closure (B, 5) at which each finger first touches the object of a grasp.

    Args:
        hands: the B hands.
        solids: the B objects.
        position: (B, 3) m, positions of the objects.
        rotation: (B, 3) rad, rotation vectors of the objects.
        opposition: (B,) rad, opposition of the thumbs.

    Returns:
        Closures from 0, open, to 1, closed. A finger that touches nothing has a usual closure.
    """
    count = len(position)
    rows = np.arange(count)
    first = np.full((count, FINGERS), np.nan)
    matrix = Rotation.from_rotvec(rotation).as_matrix()
    for closed in np.linspace(0, 1, CLOSURES):
        q = np.broadcast_to(OPEN + closed * (CLOSED - OPEN), (count, FINGERS, 2))
        pose = hands.pose(rows, q, opposition)
        contacts = collisions(hands, solids, rows, pose, position, matrix, palm=False)
        touches = np.zeros(first.shape, dtype=bool)
        touches[contacts.row, part_of(contacts.patch)] = True
        first[touches & np.isnan(first)] = closed
    is_empty = ~np.isfinite(solids.bounding_radius[:, :1]).any(axis=1, keepdims=True)
    untouched = np.where(is_empty, IDLE, RELAXED)
    return np.where(np.isnan(first), untouched, first)


def _closures(
    hands: Hands, solids: Solids, position: np.ndarray, rotation: np.ndarray, opposition: np.ndarray
) -> np.ndarray:
    """Return the closure (B, G, 5) of each grasp; the arguments are as in `closure`, by grasp."""
    closures = list[np.ndarray]()
    for grasp in range(position.shape[1]):
        closures.append(
            closure(hands, solids, position[:, grasp], rotation[:, grasp], opposition[:, grasp])
        )
    return np.stack(closures, axis=1)


def _draw(
    grasp_object: GraspObject, habit: np.random.Generator, rng: np.random.Generator, grasps: int
) -> tuple[np.ndarray, ...]:
    """Return position, rotation, opposition and squeeze of G grasps.

    Args:
        grasp_object: the object.
        habit: draws the usual grasp of the object.
        rng: draws the deviations of a recording and of its grasps.
        grasps: G, number of grasps.

    Returns:
        Position (G, 3) m, rotation vector (G, 3) rad, opposition (G,) rad and squeeze (G, 5) N m.
    """
    freedom = _freedom(grasp_object)
    roll = rng.normal(0, ROLL, grasps) + np.pi * rng.integers(2, size=grasps)
    about_axis = Rotation.from_rotvec(roll[:, None] * [0, 0, 1])
    turn = Rotation.from_rotvec(freedom * _deviations(habit, rng, ROTATION, (grasps, 3)))
    rotation = turn * Rotation.from_rotvec(grasp_object.orientation) * about_axis
    below = np.array([grasp_object.lowest(matrix) for matrix in rotation.as_matrix()])
    if grasp_object.pinch:
        position = np.tile(PINCH, (grasps, 1))
    else:
        position = np.tile(POWER, (grasps, 1))
        position[:, 2] += below
    position += freedom * _deviations(habit, rng, POSITION, (grasps, 3)) * [1, 1, 0.3]
    position[:, 2] = np.maximum(position[:, 2], below - DIP)
    of_thumb = freedom * _deviations(habit, rng, THUMB, (grasps, 1))[:, 0]
    opposition = np.clip(OPPOSITION + of_thumb, ASIDE, LARGEST_OPPOSITION)
    usual_squeeze = SQUEEZE[0] + SQUEEZE[1] * grasp_object.weight * 1e-3
    of_fingers = freedom * _deviations(habit, rng, FINGER, (grasps, FINGERS))
    squeeze = usual_squeeze * np.exp(of_fingers)
    return position, rotation.as_rotvec(), opposition, squeeze


def _deviations(
    habit: np.random.Generator,
    rng: np.random.Generator,
    std: dict[str, float],
    shape: tuple[int, int],
) -> np.ndarray:
    """Return deviations (G, size) from what all objects have in common.

    Args:
        habit: draws the deviation of the object.
        rng: draws the deviations of the recording and of its grasps.
        std: standard deviations `object`, `recording` and `grasp`.
        shape: (G, size), shape of the result.
    """
    _, size = shape
    of_object = habit.normal(0, std["object"], size)
    of_recording = rng.normal(0, std["recording"], size)
    return of_object + of_recording + rng.normal(0, std["grasp"], shape)


def _freedom(grasp_object: GraspObject) -> float:
    """Return the factor on all deviations of a grasp.

    It is smaller for an object between the fingertips, which would lose it otherwise.
    """
    if grasp_object.pinch:
        return PINCHED
    return 1.0
