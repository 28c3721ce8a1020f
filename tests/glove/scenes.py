"""Small scenes of the virtual glove whose end is known, or soon found by SciPy's Radau."""

from itertools import pairwise

import numpy as np

from benchmarks.solver.other_integrators import integrate_with_scipy
from benchmarks.solver.scenes import THICKNESS, ball_grasp, stiffness
from tactile_viewgcn.glove.contact import HOLDING, Layer, Mechanics
from tactile_viewgcn.glove.hand import LINK_PATCHES, Hand, Hands, stag_hand
from tactile_viewgcn.glove.scene import OPEN
from tactile_viewgcn.glove.shapes import Primitive, Solids, box, sphere
from tests.gloves import constant_drive

RATE = 7.35  # frames a second, STAG's
FRAME = 1 / RATE
DEFAULT = Layer(2.5e7, THICKNESS, 0.02, 60.0)  # of params.yaml
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
BALL, BALL_AT = sphere(0.034), (0.075, 0.0, 0.037)  # m: above the palm, so that only fingers touch it at first
RTOL, MOST = 1e-6, 60_000  # of Radau, and the evaluations it may take
FLAT = (0.08, 0.04, 0.03)  # m: a plate that lies on the palm between the fingers and the thumb
MIDDLE, FIRM = 0.02, 15_000.0  # m: its x; N/m of its sensors together, or more: so it sinks in by less than
SUNK = 2e-4  # m: its two outer rows of sensors carry it, the next ones are 0.5 mm lower


def skin(setting: tuple[float, float, float, float]) -> Layer:
    """The layer of one of GRASPS."""
    return Layer(setting[0], DEFAULT.thickness, *setting[2:])


def lambda_h(mechanics: Mechanics, states: np.ndarray) -> str:
    """How stiff a scene was."""
    return f"lambda h = {stiffness(mechanics, states, FRAME):.1e}"


def around_a_ball(setting: tuple[float, float, float, float], posture, *, hands: int = 1, **drive) -> Mechanics:
    """Hands around a ball above the palm, the stiffness and damping one of GRASPS."""
    return held([BALL], [BALL_AT] * hands, posture, layer=skin(setting), stiffness=setting[1], opposition=0.9, **drive)


def grasp(setting: tuple[float, float, float, float], *, seed: int, frames: int) -> Mechanics:
    """A grasp of a ball from the moment the fingers begin to close; the ball is in place and the hand open."""
    return ball_grasp(*setting, rate=RATE, seed=seed).mechanics(9, 9 + frames)


def held(
    parts: list[Primitive], position, posture, *, layer: Layer = DEFAULT, stiffness: float = 2e7, knots: int = 2,
    squeeze=0.0, opposition: float = 0.3, load=(0.0, 0.0, 0.0), motion: bool = True, hands: Hands | None = None,
) -> Mechanics:  # fmt: skip
    """Hands around an object, the drive the same at all knots; B is the number of positions (B, 3)."""
    position = np.atleast_2d(np.asarray(position, dtype=float))
    count = len(position)
    drive = constant_drive(position, posture=posture, squeeze=squeeze, opposition=opposition, load=load, knots=knots)
    hands = hands or Hands([stag_hand()] * count)
    return Mechanics(hands, Solids([parts] * count), np.full(count, stiffness), drive, layer, motion=motion)


def forces(mechanics: Mechanics, states: np.ndarray) -> np.ndarray:
    """(B, T, S) N on the sensors, whichever way they face, at states (B, T, n) of the frames."""
    hands, frames, _ = states.shape
    out, rows = np.zeros((hands, frames, len(mechanics.hands.patch))), np.arange(hands)
    for t in range(frames):
        balance = mechanics.evaluate(rows, np.full(hands, t + 1.0), states[:, t], palm=True)
        np.add.at(out[:, t], (balance.contacts.row, balance.contacts.sensor), balance.force)
    return out


def energies(mechanics: Mechanics, y: np.ndarray, states: np.ndarray) -> np.ndarray:
    """(B, T + 1) J: U - drive . y of the start (B, n) and of the frames (B, T, n)."""
    path, rows = np.concatenate([y[:, None], states], axis=1), np.arange(len(y))
    energy = [
        mechanics.evaluate(rows, np.full(len(y), float(t)), path[:, t], palm=mechanics.motion).energy
        for t in range(path.shape[1])
    ]
    return np.stack(energy, axis=1)


def radau(mechanics: Mechanics, y: np.ndarray, frames: int, *, frame: float = FRAME) -> np.ndarray:
    """States (1, frames, n) of the first hand from y (1, n)."""
    states, _ = integrate_with_scipy("Radau", mechanics, 0, y[0], frames, frame, rtol=RTOL, max_evaluations=MOST)
    return states[None]


def rel_norm_error(values: np.ndarray, exact: np.ndarray) -> float:
    """Norm of the difference over frames and sensors, over the exact values' norm; NaN where that is 0."""
    return float(np.linalg.norm(values - exact) / np.linalg.norm(exact))


def plate(lambda_h: float, *, frames: int) -> tuple[Mechanics, np.ndarray, np.ndarray]:
    """A plate that lies on two rows of the palm's sensors and is loaded more and less from frame to frame.

    As long as the same sensors carry it, its equation is linear: D dd/dt = f(t) - K d for the depth d, f linear
    between the frames, so that d has a closed form.

    Returns:
        The mechanics, the state (1, 13) at first, and the exact forces (1, frames, S) N on the sensors.
    """
    hand = stag_hand()
    x, y = hand.local[:, 0] - MIDDLE, np.abs(hand.local[:, 1])
    below = (hand.patch >= LINK_PATCHES) & (np.abs(x) < FLAT[0] / 2) & (y < FLAT[1] / 2)
    carry = below & (y > y[below].max() - 1e-6)
    damping = max(2.0, (FIRM + HOLDING) * FRAME / lambda_h)  # N s/m
    whole = damping * lambda_h / FRAME  # N/m: sensors and holding
    per_area = (whole - HOLDING) / hand.area[carry].sum()
    height = hand.local[carry, 2].mean() + FLAT[2] / 2
    # Layer and plate in series, half as stiff as each; the open fingers are no stiffer than the plate.
    layer = Layer(2 * per_area, THICKNESS, max(DEFAULT.joint_damping, FRAME / lambda_h), damping)
    mechanics = held(
        [box(*FLAT)], [MIDDLE, 0, height], OPEN - 0.2, layer=layer, stiffness=2 * per_area, knots=frames + 1
    )
    load = min(8.0, 1.5 * SUNK * whole) * np.where(np.arange(frames + 1) % 2, 1.0, 0.5)  # N
    mechanics.drive.load[0, :, 2] = -load
    start, depth, exact = mechanics.drive.position[:, 0] - [0, 0, load[1] / whole], load[1] / whole, []
    for begin, end in pairwise(load):
        lag = (end - begin) / FRAME * damping / whole
        depth = (end - lag) / whole + (depth - (begin - lag) / whole) * np.exp(-FRAME * whole / damping)
        exact.append(depth)
    force = np.array(exact)[:, None] * np.where(carry, per_area * hand.area, 0.0)
    return mechanics, np.concatenate([mechanics.drive.posture[:, 0].reshape(1, 10), start], axis=1), force[None]


def repeated_grasp(*, hands: int, grasps: int) -> tuple[Mechanics, int]:
    """Hands with every eighth sensor grasp a ball again and again, each at its own position; and a grasp's frames."""
    hand, period = stag_hand(), 20
    names = ("row", "column", "patch", "local", "normal", "area")
    fewer = Hand(*(getattr(hand, name)[::8] for name in names), hand.bases, hand.links)
    position = [0.075, 0, 0.034] + np.random.default_rng(0).normal(0, 0.002, (hands, 3)) * [1, 1, 0.1]
    mechanics = held(
        [sphere(0.03)], position, OPEN, knots=grasps * period + 1, hands=Hands([fewer] * hands), load=(0, 0, -0.5)
    )
    phase = np.arange(grasps * period + 1) % period
    closed = np.clip(np.minimum(phase - 3, period - 3 - phase) / 4, 0, 1)
    mechanics.drive.posture[:] += 0.6 * closed[:, None, None]
    mechanics.drive.squeeze[:] = 0.1 * (closed == 1)[:, None]
    return mechanics, period
