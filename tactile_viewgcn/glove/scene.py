"""Scenes: what a recording contains, from the object and the hand's fit to every squeeze, shift and release.

A recording is a row of grasps. In each, the open hand meets the object, the fingers close until they touch it, squeeze
by its weight, hold it while the grip moves a little, and let go. The numbers below are calibrated, see VERSION.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.contact import GRAVITY, Drive
from tactile_viewgcn.glove.hand import Hands
from tactile_viewgcn.glove.objects import Thing
from tactile_viewgcn.glove.shapes import Solids
from tactile_viewgcn.glove.touching import touching

OPEN, CLOSED = np.array([0.15, 0.15]), np.array([1.35, 1.45])  # rad: from and to which a finger closes
RELAXED, IDLE = 0.4, 0.2  # of that way: a finger that finds nothing; one of an empty hand
ASIDE = 0.3  # rad: the thumb's opposition while the hand is open
AWAY = 0.08  # m: how far the object is off before and after a grasp
POWER = np.array([0.080, 0.002, 0.001])  # m: where an object lies against the palm, its lower side at z
PINCH = np.array([0.080, 0.018, 0.070])  # m: where the fingertips meet the thumb's
DIP = 0.001  # m by which an object may be wanted inside the palm
WANDER = 0.9  # correlation of a wandering grip from frame to frame
PHASES = {"rest": 4, "approach": 3, "close": 3, "load": 2, "hold": 0, "release": 3}  # frames; hold takes the rest


@dataclass(frozen=True)
class Habits:
    """How grasps vary; spreads are standard deviations, `recording` from one recording to another, `grasp` inside one.

    Attributes:
        place_recording, place_grasp: m; turn_recording, turn_grasp: rad; roll: rad about the object's own axis.
        finger: of the logarithm of each finger's share of the squeeze.
        opposition: rad: mean and spread.
        squeeze: N m: of a weightless object, and added per kilogram.
        shift_place: m; shift_turn: rad: how far the object wanders within a grasp.
        tremor: share of the squeeze that comes and goes.
    """

    place_recording: float = 0.004
    place_grasp: float = 0.003
    turn_recording: float = 0.15
    turn_grasp: float = 0.10
    roll: float = 0.25
    finger: float = 0.25
    opposition: tuple[float, float] = (0.95, 0.15)
    squeeze: tuple[float, float] = (0.07, 0.58)
    shift_place: float = 0.0015
    shift_turn: float = 0.04
    tremor: float = 0.12


@dataclass(frozen=True)
class Plan:
    """A batch of B recordings of T frames before their mechanics.

    Attributes:
        drive: at T + 1 knots, frame t at knot t + 1.
        held: bool (T,), the steady part of a grasp; grasp: (T,) its number.
    """

    drive: Drive
    held: np.ndarray
    grasp: np.ndarray


@dataclass(frozen=True)
class _Grasps:
    """How the object lies in each of G grasps: (B, G, ...)."""

    place: np.ndarray
    turn: np.ndarray
    opposition: np.ndarray
    squeeze: np.ndarray


def plan(
    things: list[Thing], hands: Hands, solids: Solids, rngs: list[np.random.Generator], habits: Habits, *,
    frames: int, grasps: int, effects: frozenset[str],
) -> Plan:  # fmt: skip
    """Scenes for B recordings, each from a generator of its own.

    Raises:
        ValueError: grasps too short for their phases.
    """
    phase, share, grasp = schedule(frames, grasps)
    drawn = [_draw(thing, rng, grasps, habits) for thing, rng in zip(things, rngs, strict=True)]
    lie = _Grasps(*(np.stack(parts) for parts in zip(*drawn, strict=True)))
    touch = np.stack([closing(hands, solids, lie, g) for g in range(grasps)], axis=1)  # (B, G, 5)
    near = np.select([phase == 0, phase == 1, phase == 5], [0, share, 1 - share], 1.0)  # (T,) 1: object in place
    closed = np.select([phase <= 1, phase == 2, phase == 5], [0, share, 1 - share], 1.0)
    loaded = np.select([phase <= 2, phase == 3, phase == 5], [0, share, np.maximum(1 - 2 * share, 0)], 1.0)
    wander = np.zeros((len(things), frames, 11))
    if effects & {"shift", "tremor"}:
        wander = np.stack([_wander(rng, frames, 11) for rng in rngs])
    place, turn = lie.place[:, grasp].copy(), lie.turn[:, grasp].copy()
    squeeze = lie.squeeze[:, grasp] * loaded[:, None]
    if "shift" in effects:
        place += habits.shift_place * loaded[:, None] * wander[..., :3]
        turn += habits.shift_turn * loaded[:, None] * wander[..., 3:6]
    if "tremor" in effects:
        squeeze *= np.exp(habits.tremor * wander[..., 6:])
    place[..., 2] += AWAY * (1 - near)
    posture = OPEN + (closed[:, None] * touch[:, grasp])[..., None] * (CLOSED - OPEN)
    load = np.zeros((len(things), frames, 3))
    if "weight" in effects:
        load[..., 2] = -1e-3 * GRAVITY * np.array([[thing.weight] for thing in things]) * loaded
    opposition = ASIDE + (lie.opposition[:, grasp] - ASIDE) * near
    drive = Drive(*(np.concatenate([x[:, :1], x], axis=1) for x in (posture, squeeze, opposition, place, turn, load)))
    return Plan(drive, phase == 4, grasp)


def schedule(frames: int, grasps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number of the phase, share of it that is over at the frame's end, and number of the grasp, (T,) each."""
    each, fixed = frames // grasps, sum(PHASES.values())
    if each <= fixed:
        raise ValueError(f"{frames} frames for {grasps} grasps leave {each} each; expected more than {fixed}")
    lengths = np.array([length or each - fixed for length in PHASES.values()])
    lengths[0] += frames - each * grasps  # what does not divide is rest, before the first grasp
    starts = np.concatenate([[0], np.cumsum(lengths)])
    inside = np.concatenate([np.arange(starts[-1]), np.tile(np.arange(starts[-1] - each, starts[-1]), grasps - 1)])
    phase = np.searchsorted(starts, inside, side="right") - 1
    grasp = np.concatenate([np.zeros(starts[-1], dtype=int), np.repeat(np.arange(1, grasps), each)])
    return phase, (inside + 1 - starts[phase]) / lengths[phase], grasp


def closing(hands: Hands, solids: Solids, lie: _Grasps, g: int) -> np.ndarray:
    """How far (B, 5) each finger closes, 0 open to 1 closed, until it touches the object of grasp g."""
    if not solids.some:
        return np.full((len(lie.place), 5), IDLE)
    rows, steps = np.arange(len(lie.place)), 28
    share = np.full((len(rows), 5), np.nan)
    turn = Rotation.from_rotvec(lie.turn[:, g]).as_matrix()
    for part in np.linspace(0, 1, steps):
        q = np.broadcast_to(OPEN + part * (CLOSED - OPEN), (len(rows), 5, 2))
        pose = hands.pose(rows, q, lie.opposition[:, g])
        touch = touching(hands, solids, rows, pose, lie.place[:, g], turn, palm=False)
        found = np.zeros(share.shape, dtype=bool)
        found[touch.row, touch.patch // 3] = True
        share[found & np.isnan(share)] = part
    empty = ~np.isfinite(solids.reach[:, :1]).any(axis=1, keepdims=True)
    return np.where(np.isnan(share), np.where(empty, IDLE, RELAXED), share)


def _draw(
    thing: Thing, rng: np.random.Generator, grasps: int, habits: Habits
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Place (G, 3), turn (G, 3), opposition (G,) and squeeze (G, 5) of a recording's grasps."""
    own = Rotation.from_rotvec([0, 0, rng.normal(0, habits.roll) + np.pi * rng.integers(2)])
    tilt = Rotation.from_rotvec(rng.normal(0, habits.turn_recording, 3))
    each = Rotation.from_rotvec(rng.normal(0, habits.turn_grasp, (grasps, 3)))
    turn = each * (tilt * Rotation.from_rotvec(thing.lie) * own)
    matrix = turn.as_matrix()
    height = np.array([thing.extent(one, np.array([0.0, 0.0, -1.0])) for one in matrix])
    place = np.tile(PINCH if thing.pinch else POWER, (grasps, 1))
    if thing.place is not None:
        place = np.tile(np.array(thing.place, dtype=float), (grasps, 1))
    elif not thing.pinch:
        place[:, 2] += height
    place += rng.normal(0, habits.place_recording, 3) * [1, 1, 0.3]
    place += rng.normal(0, habits.place_grasp, (grasps, 3)) * [1, 1, 0.3]
    if thing.place is None:
        place[:, 2] = np.maximum(place[:, 2], height - DIP)
    opposition = np.clip(rng.normal(*habits.opposition) + rng.normal(0, 0.05, grasps), ASIDE, 1.4)
    fingers = rng.normal(0, habits.finger, 5) + rng.normal(0, habits.finger / 3, (grasps, 5))
    squeeze = (habits.squeeze[0] + habits.squeeze[1] * thing.weight * 1e-3) * np.exp(fingers)
    return place, turn.as_rotvec(), opposition, squeeze


def _wander(rng: np.random.Generator, frames: int, channels: int) -> np.ndarray:
    """(T, channels) of a slow autoregression of order 1 and unit variance."""
    noise = rng.normal(size=(frames, channels))
    noise[1:] *= np.sqrt(1 - WANDER**2)
    return lfilter([1.0], [1.0, -WANDER], noise, axis=0)
