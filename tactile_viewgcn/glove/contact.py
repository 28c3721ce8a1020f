"""Contact: skin and glove as an elastic layer in series with the object, joints and object overdamped.

The unknowns y of a hand are ten joint coordinates (5, 2) and, where the object moves, its position (3,). They follow

    D dy/dt = drive(t) - dU/dy,    U = sum_s k A_s d_s^2 / 2  +  joints  +  limits  +  holding,

with d_s the depth of sensor s inside the object, A_s its area and k the stiffness per area of the two layers in
series (elastic or Winkler foundation: Johnson, "Contact Mechanics" (1985), section 4.3). A sensor's force is k A d
along the object's normal. Friction is lumped into `holding`, a spring between the object and the place that the
scene wants it at. The Hessian leaves out the curvature of the contact (Gauss-Newton), so it is never indefinite.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.hand import COUPLING, LINK_PATCHES, Hands, Pose
from tactile_viewgcn.glove.shapes import Solids
from tactile_viewgcn.glove.touching import NO_CONTACTS, Contacts, touching

LIMITS = np.array([[-0.3, 1.6], [-0.1, 1.9]])  # rad: beyond them a stiff spring
JOINT = np.array([0.25, 0.16])  # N m / rad
LIMIT = 6.0  # N m / rad
TENDON = np.array([1.0, 0.5])  # what a finger's squeeze gives to its two coordinates
HOLDING = 1500.0  # N/m
GRAVITY = 9.81  # m/s^2
LEVER = 0.05  # m: makes torques and forces comparable


@dataclass(frozen=True)
class Layer:
    """The elastic layer and the damping: what makes a scene stiff.

    Args:
        stiffness: Pa/m of skin and glove, their modulus over their thickness.
        thickness: m; deeper penetration is counted.
        joint_damping: N m s / rad; object_damping: N s / m.

    Raises:
        ValueError: one that is not above 0, or not finite.
    """

    stiffness: float
    thickness: float
    joint_damping: float
    object_damping: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 < value < np.inf:
                raise ValueError(f"{name} is {value}; expected more than 0, and finite")

    def series(self, stiffness: np.ndarray) -> np.ndarray:
        """Pa/m of the layer in series with objects of some stiffness."""
        return 1 / (1 / self.stiffness + 1 / stiffness)


@dataclass(frozen=True)
class Drive:
    """What the scenes prescribe, (B, K, ...) at K knots one frame apart; linear between them.

    Attributes:
        posture: (B, K, 5, 2) rad that the joints' springs pull to; squeeze: (B, K, 5) N m of each finger on top.
        opposition: (B, K) rad of the thumb.
        place: (B, K, 3) m, where the object is wanted; turn: (B, K, 3) rotation vector.
        load: (B, K, 3) N on the object.
    """

    posture: np.ndarray
    squeeze: np.ndarray
    opposition: np.ndarray
    place: np.ndarray
    turn: np.ndarray
    load: np.ndarray

    def at(self, rows: np.ndarray, time: np.ndarray) -> dict[str, np.ndarray]:
        """Values of some rows (R,) at times (R,), in frames since the first knot."""
        out, last = {}, self.squeeze.shape[1] - 1
        knot = np.minimum(time.astype(int), last - 1)
        share = np.minimum(time - knot, 1.0)
        for name, values in vars(self).items():
            here, there = values[rows, knot], values[rows, knot + 1]
            weight = share.reshape(-1, *[1] * (here.ndim - 1))
            out[name] = here + weight * (there - here)
        return out


@dataclass(frozen=True)
class Balance:
    """The mechanics of R rows at one state.

    Attributes:
        residual: (R, n) dU/dy - drive.
        energy: (R,) U - drive . y.
        fingers: (R, 5, 2, 2), cross: (R, 5, 2, 3), thing: (R, 3, 3), empty without motion: the Hessian's blocks.
        contacts: the sensors in contact; force: (C,) N along the contact's normal.
        slope: (C, 5) of each depth in the two coordinates of its finger and the object's three.
        facing: (C,) cosine between the sensor's and the contact's pressure direction, not below 0.
    """

    residual: np.ndarray
    energy: np.ndarray
    fingers: np.ndarray
    cross: np.ndarray
    thing: np.ndarray
    contacts: Contacts
    force: np.ndarray
    slope: np.ndarray
    facing: np.ndarray


class Mechanics:
    """The ordinary differential equation of B hands; `motion` adds the object's three unknowns.

    Args:
        hands, solids: B of each; stiffness: (B,) Pa/m of the objects.
        names: of the objects, for errors.

    Raises:
        ValueError: an object that starts inside the palm.
    """

    def __init__(
        self, hands: Hands, solids: Solids, stiffness: np.ndarray, drive: Drive, layer: Layer, *,
        motion: bool, names: list[str] | None = None,
    ):  # fmt: skip
        self.names = names
        self.hands, self.solids, self.drive, self.layer, self.motion = hands, solids, drive, layer, motion
        self.stiffness = layer.series(np.asarray(stiffness, dtype=float))
        self.size = 13 if motion else 10
        self.damping = np.full(self.size, layer.joint_damping)
        self.damping[10:] = layer.object_damping
        self.lever = np.ones(self.size)  # makes the torque of a joint and the force on the object comparable
        self.lever[10:] = LEVER

    def start(self) -> np.ndarray:
        """(B, n): everything where the scene wants it at first."""
        if self.solids.some:
            self._outside_the_palm()
        count = len(self.stiffness)
        y = np.zeros((count, self.size))
        y[:, :10] = self.drive.posture[:, 0].reshape(count, 10)
        if self.motion:
            y[:, 10:] = self.drive.place[:, 0]
        return y

    def _outside_the_palm(self) -> None:
        """Refuses an object that starts inside the palm: there it may come out behind."""
        rows, place, turn = np.arange(len(self.stiffness)), self.drive.place[:, 0], _matrix(self.drive.turn[:, 0])
        pose = self.hands.pose(rows, self.drive.posture[:, 0], self.drive.opposition[:, 0])
        inside = touching(self.hands, self.solids, rows, pose, place, turn, palm=True)
        if (inside.patch >= LINK_PATCHES).any():
            worst = np.where(inside.patch >= LINK_PATCHES, inside.depth, 0).argmax()
            raise ValueError(
                f"object {self.names[inside.row[worst]] if self.names else inside.row[worst]} starts "
                f"{inside.depth[worst] * 1e3:.3g} mm inside the palm; expected it outside; start it further away"
            )

    def balance(self, rows: np.ndarray, time: np.ndarray, y: np.ndarray, *, palm: bool) -> Balance:
        """Forces, energy and Hessian of rows (R,) at times (R,) and y (R, n); `palm`: with the palm's sensors."""
        now = self.drive.at(rows, time)
        q, count = y[:, :10].reshape(-1, 5, 2), len(rows)
        thing = y[:, 10:] if self.motion else now["place"]
        touch, slope, facing = self._contacts(rows, q, thing, now, palm=palm)
        own = rows[touch.row], touch.sensor
        stiff = self.stiffness[own[0]] * self.hands.area[own]
        force = stiff * touch.depth
        group = touch.row * 6 + np.minimum(touch.patch // 3, 5)
        pulls, blocks = _sums(group, count * 6, slope, force, stiff)
        pulls, blocks = pulls.reshape(count, 6, 5), blocks.reshape(count, 6, 5, 5)
        residual = np.zeros((count, self.size))
        bend = q - now["posture"]
        over = q - np.clip(q, LIMITS[:, 0], LIMITS[:, 1])
        torque = now["squeeze"][..., None] * TENDON
        residual[:, :10] = (JOINT * bend + LIMIT * over + pulls[:, :5, :2] - torque).reshape(count, 10)
        energy = 0.5 * (JOINT * bend**2 + LIMIT * over**2).sum(axis=(1, 2)) - (torque * q).sum(axis=(1, 2))
        energy += 0.5 * np.bincount(touch.row, force * touch.depth, count)
        block = blocks[:, :5, :2, :2].copy()
        block[..., [0, 1], [0, 1]] += JOINT + LIMIT * (over != 0)
        whole = np.empty((count, 0, 0))
        if self.motion:
            whole = blocks[:, :, 2:, 2:].sum(axis=1) + HOLDING * np.eye(3)
            apart = thing - now["place"]
            residual[:, 10:] = HOLDING * apart + pulls[:, :, 2:].sum(axis=1) - now["load"]
            energy += 0.5 * HOLDING * (apart**2).sum(axis=1) - (now["load"] * thing).sum(axis=1)
        return Balance(residual, energy, block, blocks[:, :5, :2, 2:], whole, touch, force, slope, facing)

    def _contacts(
        self, rows: np.ndarray, q: np.ndarray, place: np.ndarray, now: dict[str, np.ndarray], *, palm: bool
    ) -> tuple[Contacts, np.ndarray, np.ndarray]:
        """The contacts, their slopes (C, 5), and which way the sensors face (C,); nobody looks where no object is."""
        if not self.solids.some:
            return NO_CONTACTS, np.zeros((0, 5)), np.zeros(0)
        pose = self.hands.pose(rows, q, now["opposition"])
        touch = touching(self.hands, self.solids, rows, pose, place, _matrix(now["turn"]), palm=palm)
        own = rows[touch.row], touch.sensor
        skin = np.einsum("nij,nj->ni", pose.axes[touch.row, touch.patch], self.hands.normal[own])
        return touch, self._slope(touch, pose), np.maximum(-np.einsum("ni,ni->n", skin, touch.normal), 0)

    def _slope(self, touch: Contacts, pose: Pose) -> np.ndarray:
        """(C, 5) of each depth in its finger's two coordinates, 0 on the palm, and in the object's three."""
        slope = np.zeros((len(touch.row), 5))
        slope[:, 2:] = touch.normal
        on = touch.patch < LINK_PATCHES
        r, finger, link = touch.row[on], touch.patch[on] // 3, touch.patch[on] % 3
        spin = _cross(pose.hinge[r, finger], touch.normal[on])  # n . (hinge x arm) = -arm . (hinge x n)
        arm = touch.point[on, None] - pose.origin[r[:, None], 3 * finger[:, None] + np.arange(3)]  # (C, 3 joints, 3)
        by_joint = np.einsum("nji,ni->nj", arm, spin) * (np.arange(3) <= link[:, None])
        slope[on, :2] = by_joint @ COUPLING
        return slope

    def change(self, at: Balance, rows: np.ndarray, dy: np.ndarray) -> np.ndarray:
        """(C,) N by which the contacts' forces change when the unknowns do by dy (R, n), to first order."""
        row, finger = at.contacts.row, np.minimum(at.contacts.patch // 3, 4)
        deeper = np.einsum("ni,ni->n", at.slope[:, :2], dy[:, :10].reshape(-1, 5, 2)[row, finger])
        if self.motion:
            deeper += np.einsum("ni,ni->n", at.slope[:, 2:], dy[row, 10:])
        return self.stiffness[rows[row]] * self.hands.area[rows[row], at.contacts.sensor] * deeper

    def hessian(self, at: Balance) -> np.ndarray:
        """The Gauss-Newton Hessian of U as (R, n, n)."""
        out = np.zeros((*at.residual.shape, self.size))
        for finger in range(5):
            own = slice(2 * finger, 2 * finger + 2)
            out[:, own, own] = at.fingers[:, finger]
            if self.motion:
                out[:, own, 10:] = at.cross[:, finger]
                out[:, 10:, own] = at.cross[:, finger].swapaxes(1, 2)
        if self.motion:
            out[:, 10:, 10:] = at.thing
        return out

    def solve(self, at: Balance, shift: np.ndarray, residual: np.ndarray) -> np.ndarray:
        """x (R, n) of (Hessian + diag(shift)) x = residual, for shift (R, n): fingers first, then the object."""
        count = len(residual)
        block = at.fingers.copy()
        block[..., [0, 1], [0, 1]] += shift[:, :10].reshape(count, 5, 2)
        inverse = _inverse(block)
        on_fingers = residual[:, :10].reshape(count, 5, 2)
        if not self.motion:
            return np.einsum("rfij,rfj->rfi", inverse, on_fingers).reshape(count, 10)
        through = np.einsum("rfji,rfjk->rfik", at.cross, inverse)  # (R, 5, 3, 2)
        schur = at.thing - np.einsum("rfij,rfjk->rik", through, at.cross)
        schur[:, [0, 1, 2], [0, 1, 2]] += shift[:, 10:]
        right = residual[:, 10:] - np.einsum("rfij,rfj->ri", through, on_fingers)
        thing = np.linalg.solve(schur, right[..., None])[..., 0]
        rest = on_fingers - np.einsum("rfij,rj->rfi", at.cross, thing)
        x = np.einsum("rfij,rfj->rfi", inverse, rest).reshape(count, 10)
        return np.concatenate([x, thing], axis=1)


def _matrix(turn: np.ndarray) -> np.ndarray:
    """Rotation matrices (R, 3, 3) of rotation vectors (R, 3)."""
    return Rotation.from_rotvec(turn).as_matrix()


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products (n, 3); np.cross takes ten times as long on few rows."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def _inverse(block: np.ndarray) -> np.ndarray:
    """Inverses of (..., 2, 2)."""
    a, b, c, d = block[..., 0, 0], block[..., 0, 1], block[..., 1, 0], block[..., 1, 1]
    adjugate = np.stack([d, -b, -c, a], axis=-1).reshape(block.shape)
    return adjugate / (a * d - b * c)[..., None, None]


def _sums(
    group: np.ndarray, groups: int, slope: np.ndarray, force: np.ndarray, stiff: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Per group: sum of force x slope (G, 5), and of stiff x slope slope' (G, 5, 5); entries come group by group."""
    pulls, blocks = np.zeros((groups, 5)), np.zeros((groups, 5, 5))
    if len(group):
        starts = np.flatnonzero(np.concatenate([[True], group[1:] != group[:-1]]))
        at = group[starts]
        pulls[at] = np.add.reduceat(force[:, None] * slope, starts)
        outer = (stiff[:, None] * slope)[:, :, None] * slope[:, None, :]
        blocks[at] = np.add.reduceat(outer, starts)
    return pulls, blocks
