"""Scenes: what a recording contains, from the object and the hand to every squeeze, shift and release.

A recording is a sequence of grasps. In each, the open hand meets the object, the fingers close until they touch it,
squeeze it more the heavier it is, hold it while the grip moves a little, and let go. The numbers below belong to the
calibrated constants, see VERSION in `recipe.py`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.glove.collision import collisions
from tactile_viewgcn.glove.contact import GRAVITY
from tactile_viewgcn.glove.drive import Drive
from tactile_viewgcn.glove.hand import Hands
from tactile_viewgcn.glove.objects import GraspObject
from tactile_viewgcn.glove.shapes import Solids
from tactile_viewgcn.notes import several

OPEN, CLOSED = np.array([0.15, 0.15]), np.array([1.35, 1.45])  # rad: posture of an open and of a closed finger
RELAXED, IDLE = 0.4, 0.2  # closure, 0 open to 1 closed: of a finger that meets nothing; of an empty hand
ASIDE = 0.3  # rad: the thumb's opposition while the hand is open
AWAY = 0.08  # m above its position in the grasp: the object before and after
POWER = np.array([0.080, 0.002, 0.001])  # m: where an object lies against the palm, its lower side at z
PINCH = np.array([0.080, 0.018, 0.070])  # m: where the fingertips meet the thumb's
DIP = 0.001  # m by which the prescribed position may press an object into the palm
CORRELATION = 0.9  # of a drifting grip, from frame to frame
CLOSURES = 28  # closures at which a finger is tested for contact
#: standard deviations, from one recording to another and from one grasp to another
POSITION_OF_RECORDING, POSITION_OF_GRASP = 0.004, 0.003  # m, of the object
ROTATION_OF_RECORDING, ROTATION_OF_GRASP, ROLL = 0.15, 0.10, 0.25  # rad, of the object; about its own axis
FINGER = 0.25  # of the logarithm of each finger's part of the squeeze
SHIFT_POSITION, SHIFT_ROTATION, TREMOR = 0.0015, 0.04, 0.12  # within a grasp: m, rad, of the squeeze's logarithm
OPPOSITION = (0.95, 0.15)  # rad, mean and standard deviation
SQUEEZE = (0.07, 0.58)  # N m of a weightless object, and N m per kg of weight
PHASES = {"open": 4, "approach": 3, "close": 3, "load": 2, "hold": 0, "release": 3}  # frames; `hold` fills the grasp


@dataclass(frozen=True)
class Plan:
    """The scenes of B recordings of T frames, before their mechanics are solved.

    Attributes:
        drive: at T + 1 knots; frame t ends at knot t + 1.
        steady: (T,) bool, the steady part of a grasp.
        grasp: (T,) number of the grasp.
    """

    drive: Drive
    steady: np.ndarray
    grasp: np.ndarray


def plan(
    grasp_objects: list[GraspObject], hands: Hands, solids: Solids, rngs: list[np.random.Generator],
    *, frames: int, grasps: int, effects: frozenset[str],
) -> Plan:  # fmt: skip
    """Scenes of B recordings, each drawn from its own generator.

    Raises:
        UserError: grasps too short for their phases.
    """
    phase, progress, grasp = schedule(frames, grasps)
    drawn = [_draw(one, rng, grasps) for one, rng in zip(grasp_objects, rngs, strict=True)]
    grips = [np.stack(values) for values in zip(*drawn, strict=True)]  # (B, G, ...) each
    closed = np.stack([closure(hands, solids, *(one[:, g] for one in grips[:3])) for g in range(grasps)], axis=1)
    position, rotation, opposition, squeeze = (one[:, grasp] for one in grips)
    # (T,) each, 0 to 1: the object has arrived, the fingers have closed, they squeeze.
    near = np.select([phase == 0, phase == 1, phase == 5], [0, progress, 1 - progress], 1.0)
    closing = np.select([phase <= 1, phase == 2, phase == 5], [0, progress, 1 - progress], 1.0)
    loaded = np.select([phase <= 2, phase == 3, phase == 5], [0, progress, np.maximum(1 - 2 * progress, 0)], 1.0)
    drift = np.zeros((len(grasp_objects), frames, 11))
    if effects & {"shift", "tremor"}:
        drift = np.stack([_drift(rng, frames, 11) for rng in rngs])
    squeeze *= loaded[:, None]
    if "shift" in effects:
        position += SHIFT_POSITION * loaded[:, None] * drift[..., :3]
        rotation += SHIFT_ROTATION * loaded[:, None] * drift[..., 3:6]
    if "tremor" in effects:
        squeeze *= np.exp(TREMOR * drift[..., 6:])
    position[..., 2] += AWAY * (1 - near)
    posture = OPEN + (closing[:, None] * closed[:, grasp])[..., None] * (CLOSED - OPEN)
    load = np.zeros((len(grasp_objects), frames, 3))
    if "weight" in effects:
        load[..., 2] = -1e-3 * GRAVITY * np.array([[one.weight] for one in grasp_objects]) * loaded
    opposition = ASIDE + (opposition - ASIDE) * near
    frames_of = (posture, squeeze, opposition, position, rotation, load)
    drive = Drive(*(np.concatenate([values[:, :1], values], axis=1) for values in frames_of))
    return Plan(drive, phase == 4, grasp)


def schedule(frames: int, grasps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number of the phase, progress of the phase at the frame's end (0 to 1), and number of the grasp, (T,) each.

    Raises:
        UserError: grasps too short for their phases.
    """
    each, fixed = frames // grasps, sum(PHASES.values())
    if each <= fixed:
        raise UserError(
            f"{several(frames, 'frame')} for {several(grasps, 'grasp')} leave {each} each; expected more than {fixed}"
        )
    lengths = np.array([length or each - fixed for length in PHASES.values()])
    lengths[0] += frames - each * grasps  # the remainder goes to the open hand before the first grasp
    starts = np.concatenate([[0], np.cumsum(lengths)])
    inside = np.concatenate([np.arange(starts[-1]), np.tile(np.arange(starts[-1] - each, starts[-1]), grasps - 1)])
    phase = np.searchsorted(starts, inside, side="right") - 1
    grasp = np.concatenate([np.zeros(starts[-1], dtype=int), np.repeat(np.arange(1, grasps), each)])
    return phase, (inside + 1 - starts[phase]) / lengths[phase], grasp


def closure(
    hands: Hands, solids: Solids, position: np.ndarray, rotation: np.ndarray, opposition: np.ndarray
) -> np.ndarray:
    """Closure (B, 5), 0 open to 1 closed, at which each finger first touches the object of a grasp.

    The object is at `position` (B, 3) m, turned by the vectors `rotation` (B, 3) rad; opposition (B,) rad.
    """
    count = len(position)
    if not solids.has_primitives:
        return np.full((count, 5), IDLE)
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


def _draw(grasp_object: GraspObject, rng: np.random.Generator, grasps: int) -> tuple[np.ndarray, ...]:
    """Position (G, 3) m, rotation vector (G, 3) rad, opposition (G,) rad and squeeze (G, 5) N m of G grasps."""
    roll = Rotation.from_rotvec([0, 0, rng.normal(0, ROLL) + np.pi * rng.integers(2)])
    tilt = Rotation.from_rotvec(rng.normal(0, ROTATION_OF_RECORDING, 3))
    each = Rotation.from_rotvec(rng.normal(0, ROTATION_OF_GRASP, (grasps, 3)))
    rotation = each * (tilt * Rotation.from_rotvec(grasp_object.orientation) * roll)
    below = np.array([grasp_object.lowest(matrix) for matrix in rotation.as_matrix()])
    position = np.tile(PINCH if grasp_object.pinch else POWER, (grasps, 1))
    if grasp_object.position is not None:
        position = np.tile(np.array(grasp_object.position, dtype=float), (grasps, 1))
    elif not grasp_object.pinch:
        position[:, 2] += below
    position += rng.normal(0, POSITION_OF_RECORDING, 3) * [1, 1, 0.3]
    position += rng.normal(0, POSITION_OF_GRASP, (grasps, 3)) * [1, 1, 0.3]
    if grasp_object.position is None:
        position[:, 2] = np.maximum(position[:, 2], below - DIP)
    opposition = np.clip(rng.normal(*OPPOSITION) + rng.normal(0, 0.05, grasps), ASIDE, 1.4)
    fingers = rng.normal(0, FINGER, 5) + rng.normal(0, FINGER / 3, (grasps, 5))
    squeeze = (SQUEEZE[0] + SQUEEZE[1] * grasp_object.weight * 1e-3) * np.exp(fingers)
    return position, rotation.as_rotvec(), opposition, squeeze


def _drift(rng: np.random.Generator, frames: int, channels: int) -> np.ndarray:
    """Autoregressive noise (T, channels) of order 1 and unit variance."""
    noise = rng.normal(size=(frames, channels))
    noise[1:] *= np.sqrt(1 - CORRELATION**2)
    return lfilter([1.0], [1.0, -CORRELATION], noise, axis=0)
