"""Contact mechanics of a hand: forces, energy and Hessian of an overdamped elastic contact.

The unknowns y of a hand are ten joint coordinates (5, 2) in rad. If the object moves, its position
(3,) in m is unknown too:

    D dy/dt = drive(t) - dU/dy,
    U = sum_s k A_s d_s^2 / 2  +  joints  +  joint limits  +  holding.

D is the damping, d_s the depth of sensor s inside the object, and A_s the sensor's area. The skin
and the surface of the object are springs in series, and k is the stiffness of both per area. This
is an elastic, or Winkler, foundation (Johnson, "Contact Mechanics" (1985), section 4.3). The force
on a sensor is k A_s d_s along the object's normal. There is no separate friction: a spring,
`holding`, pulls the object to the position that the scene prescribes. The Hessian of U omits the
curvature of the contact (Gauss-Newton) and is therefore never indefinite.
"""

import math
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.contact import Contacts, collisions
from tactile_viewgcn.glove.hand import (
    COUPLING,
    FINGERS,
    LINK_PATCHES,
    LINKS_OF_FINGER,
    PARTS,
    Hands,
    part_of,
)
from tactile_viewgcn.glove.shapes import Solids

LIMITS = np.array([[-0.3, 1.6], [-0.1, 1.9]])  # rad: ranges of the two coordinates of a finger
JOINT = np.array([0.25, 0.16])  # N m / rad: springs towards the posture
LIMIT = 6.0  # N m / rad: springs beyond LIMITS
TENDON = np.array([1.0, 0.5])  # share of a finger's squeeze that acts on each of its coordinates
HOLDING = 1500.0  # N/m: spring between the object and its prescribed position
HOLDING_HESSIAN = HOLDING * np.eye(3)
LEVER = 0.05  # m: converts between forces and torques of comparable size
JOINT_COORDINATES = 2 * FINGERS  # number of joint coordinates, which begin a state y


@dataclass(frozen=True)
class Layer:
    """Skin and glove as an elastic layer, and the damping. They decide how stiff the equation is.

    Args:
        stiffness: Pa/m, stiffness of skin and glove: modulus over thickness.
        thickness: m, unit in which the integrator measures errors of positions.
        joint_damping: N m s / rad, damping of the joints.
        object_damping: N s / m, damping of the object.
    """

    stiffness: float
    thickness: float
    joint_damping: float
    object_damping: float


@dataclass(frozen=True)
class Drive:
    """Prescribed motion and loads at K knots, one frame apart, and linear between them.

    Attributes:
        posture: (B, K, 5, 2) rad, rest position of the joints' springs.
        squeeze: (B, K, 5) N m, torque that closes each finger.
        opposition: (B, K) rad, opposition of the thumb.
        position: (B, K, 3) m, to which a spring pulls the object.
        rotation: (B, K, 3) rotation vector of the object, rad.
        load: (B, K, 3) N, force on the object.
    """

    posture: np.ndarray
    squeeze: np.ndarray
    opposition: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    load: np.ndarray

    def at(self, rows: np.ndarray, time: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values of some hands at their times, by name.

        Args:
            rows: (R,) indices of hands.
            time: (R,) frames since the first knot.
        """
        last = self.squeeze.shape[1] - 1
        knot = np.minimum(time.astype(int), last - 1)
        fraction = np.minimum(time - knot, 1.0)
        before = self._joined[rows, knot]
        after = self._joined[rows, knot + 1]
        joined = before + fraction[:, None] * (after - before)
        now = dict[str, np.ndarray]()
        start = 0
        for name in DRIVEN:
            shape = getattr(self, name).shape[2:]
            stop = start + math.prod(shape)
            now[name] = joined[:, start:stop].reshape(len(rows), *shape)
            start = stop
        return now

    @cached_property
    def _joined(self) -> np.ndarray:
        """Return all values (B, K, n) side by side, since one gather is faster than one of each."""
        hands, knots = self.opposition.shape
        values = [getattr(self, name).reshape(hands, knots, -1) for name in DRIVEN]
        return np.concatenate(values, axis=2)


#: Names of the prescribed values.
DRIVEN = tuple(field.name for field in fields(Drive))


@dataclass(frozen=True)
class Balance:
    """Forces, energy and Hessian of R hands at one state.

    Attributes:
        residual: (R, n) dU/dy - drive; 0 in equilibrium.
        energy: (R,) J, U - drive . y.
        fingers: (R, 5, 2, 2) blocks of the Hessian, one for each finger.
        cross: (R, 5, 2, 3) blocks of the Hessian between fingers and object.
        object: (R, 3, 3) block of the Hessian for the object; (R, 0, 0) without motion.
        contacts: the C contacts.
        force: (C,) N along the contact's normal.
        slope: (C, 5) derivatives of the depth by the two coordinates of the sensor's finger and the
            three of the object.
    """

    residual: np.ndarray
    energy: np.ndarray
    fingers: np.ndarray
    cross: np.ndarray
    object: np.ndarray
    contacts: Contacts
    force: np.ndarray
    slope: np.ndarray


class Mechanics:
    """The differential equation of B hands.

    Args:
        hands: B hands.
        solids: the B objects that they hold.
        stiffness: (B,) Pa/m, stiffness of the objects' surfaces.
        drive: prescribed motion and loads.
        layer: skin and damping.
        motion: whether the object's position is unknown too. If so, n is 13, else 10.

    Attributes:
        stiffness: (B,) Pa/m, stiffness of skin and object in series.
        size: n, number of unknowns.
        damping: (n,) N m s / rad of the joints, and N s / m of the object.
        lever: (n,) factors that make torques on joints and forces on the object comparable.
    """

    def __init__(
        self,
        hands: Hands,
        solids: Solids,
        stiffness: np.ndarray,
        drive: Drive,
        layer: Layer,
        *,
        motion: bool,
    ):
        self.hands = hands
        self.solids = solids
        self.drive = drive
        self.layer = layer
        self.motion = motion
        # the two are springs in series
        self.stiffness = 1 / (1 / layer.stiffness + 1 / np.asarray(stiffness, dtype=float))
        self.size = JOINT_COORDINATES
        if motion:
            self.size += 3
        self.damping = np.full(self.size, layer.joint_damping)
        self.damping[JOINT_COORDINATES:] = layer.object_damping
        self.lever = np.ones(self.size)
        self.lever[JOINT_COORDINATES:] = LEVER

    def initial_state(self) -> np.ndarray:
        """Return the states (B, n) in the prescribed posture and position of the first knot."""
        y = np.zeros((len(self.stiffness), self.size))
        posture = self.drive.posture[:, 0]
        y[:, :JOINT_COORDINATES] = posture.reshape(-1, JOINT_COORDINATES)
        if self.motion:
            y[:, JOINT_COORDINATES:] = self.drive.position[:, 0]
        return y

    def evaluate(self, rows: np.ndarray, time: np.ndarray, y: np.ndarray, *, palm: bool) -> Balance:
        """Return the forces, the energy and the Hessian of some hands.

        Args:
            rows: (R,) indices of the hands.
            time: (R,) frames since the first knot.
            y: (R, n) states.
            palm: whether the palm's sensors are tested for contact. Their forces matter only if the
                object moves.
        """
        count = len(rows)
        now = self.drive.at(rows, time)
        q = y[:, :JOINT_COORDINATES].reshape(-1, FINGERS, 2)
        contacts = self._touch(rows, y, now, palm=palm)
        slope = _slopes(contacts)
        stiffness = self._sensor_stiffness(rows, contacts)
        force = stiffness * contacts.depth
        gradient, blocks = _sums_by_part(contacts, count, force, stiffness, slope)
        residual = np.zeros((count, self.size))
        bend = q - now["posture"]
        beyond = q - np.clip(q, LIMITS[:, 0], LIMITS[:, 1])
        torque = now["squeeze"][..., None] * TENDON
        on_joints = JOINT * bend + LIMIT * beyond + gradient[:, :FINGERS, :2] - torque
        residual[:, :JOINT_COORDINATES] = on_joints.reshape(count, JOINT_COORDINATES)
        springs = 0.5 * (JOINT * bend**2 + LIMIT * beyond**2).sum(axis=(1, 2))
        energy = springs - (torque * q).sum(axis=(1, 2))
        energy += 0.5 * np.bincount(contacts.row, force * contacts.depth, count)
        fingers = blocks[:, :FINGERS, :2, :2].copy()
        fingers[..., [0, 1], [0, 1]] += JOINT + LIMIT * (beyond != 0)
        on_object = np.empty((count, 0, 0))
        if self.motion:
            on_object = blocks[:, :, 2:, 2:].sum(axis=1) + HOLDING_HESSIAN
            position = y[:, JOINT_COORDINATES:]
            offset = position - now["position"]
            pressed = gradient[:, :, 2:].sum(axis=1)
            residual[:, JOINT_COORDINATES:] = HOLDING * offset + pressed - now["load"]
            holding_energy = 0.5 * HOLDING * (offset**2).sum(axis=1)
            energy += holding_energy - (now["load"] * position).sum(axis=1)
        return Balance(
            residual=residual,
            energy=energy,
            fingers=fingers,
            cross=blocks[:, :FINGERS, :2, 2:],
            object=on_object,
            contacts=contacts,
            force=force,
            slope=slope,
        )

    def _sensor_stiffness(self, rows: np.ndarray, contacts: Contacts) -> np.ndarray:
        """Return the stiffness (C,) N/m of each contact of the hands `rows` (R,)."""
        hand = rows[contacts.row]
        stiffness: np.ndarray = self.stiffness[hand] * self.hands.area[hand, contacts.sensor]
        return stiffness

    def contacts(
        self, rows: np.ndarray, time: np.ndarray, y: np.ndarray, *, palm: bool
    ) -> Contacts:
        """Return the contacts of some hands. It has the same arguments as `evaluate`."""
        return self._touch(rows, y, self.drive.at(rows, time), palm=palm)

    def _touch(
        self, rows: np.ndarray, y: np.ndarray, now: dict[str, np.ndarray], *, palm: bool
    ) -> Contacts:
        """Return the contacts of some hands for the values `now` of the drive."""
        q = y[:, :JOINT_COORDINATES].reshape(-1, FINGERS, 2)
        position = now["position"]
        if self.motion:
            position = y[:, JOINT_COORDINATES:]
        pose = self.hands.pose(rows, q, now["opposition"])
        rotation = Rotation.from_rotvec(now["rotation"]).as_matrix()
        return collisions(self.hands, self.solids, rows, pose, position, rotation, palm=palm)

    def force_change(self, balance: Balance, rows: np.ndarray, dy: np.ndarray) -> np.ndarray:
        """Return the change (C,) N of the contacts' forces, to first order in a change of state.

        Args:
            balance: forces of the hands at their state.
            rows: (R,) indices of the hands.
            dy: (R, n) change of the state.
        """
        row = balance.contacts.row
        # the palm's slope by a joint is 0, so any finger can stand for it
        finger = np.minimum(balance.contacts.patch // LINKS_OF_FINGER, FINGERS - 1)
        bend = dy[:, :JOINT_COORDINATES].reshape(-1, FINGERS, 2)[row, finger]
        deeper = np.einsum("ni,ni->n", balance.slope[:, :2], bend)
        if self.motion:
            deeper += np.einsum("ni,ni->n", balance.slope[:, 2:], dy[row, JOINT_COORDINATES:])
        change: np.ndarray = self._sensor_stiffness(rows, balance.contacts) * deeper
        return change

    def shifted_hessian(self, balance: Balance, scaled_step: np.ndarray) -> "ShiftedHessian":
        """Return the matrix of Newton's equations of R hands in a stage: Hessian + damping / h'.

        Args:
            balance: Hessian of the hands at their state.
            scaled_step: (R,) s, the stage's share h' of the step.
        """
        count = len(scaled_step)
        shift = self.damping / scaled_step[:, None]
        block = balance.fingers.copy()
        block[..., [0, 1], [0, 1]] += shift[:, :JOINT_COORDINATES].reshape(count, FINGERS, 2)
        inverse = _inverse_2x2(block)
        if not self.motion:
            none = np.empty((count, 0, 0))
            return ShiftedHessian(shift, inverse, balance.cross, through=none, schur=none)
        through = np.einsum("rfji,rfjk->rfik", balance.cross, inverse)
        schur = balance.object - np.einsum("rfij,rfjk->rik", through, balance.cross)
        schur[:, [0, 1, 2], [0, 1, 2]] += shift[:, JOINT_COORDINATES:]
        return ShiftedHessian(shift, inverse, balance.cross, through, schur)


@dataclass(frozen=True)
class ShiftedHessian:
    """The matrices Hessian + diag(shift) of R hands, prepared for several right-hand sides.

    The fingers are coupled only through the object. So a 3 x 3 Schur complement is solved first,
    then each finger.

    Attributes:
        shift: (R, n) numbers that are added to the diagonal.
        inverse: (R, 5, 2, 2) inverses of the fingers' blocks.
        cross: (R, 5, 2, 3) blocks between fingers and object.
        through: (R, 5, 3, 2) blocks between object and fingers, times `inverse`; empty without
            motion.
        schur: (R, 3, 3) Schur complement of the fingers; empty without motion.
    """

    shift: np.ndarray
    inverse: np.ndarray
    cross: np.ndarray
    through: np.ndarray
    schur: np.ndarray

    def solve(self, residual: np.ndarray) -> np.ndarray:
        """Return the solution x (R, n) of (Hessian + diag(shift)) x = residual (R, n)."""
        count = len(residual)
        on_fingers = residual[:, :JOINT_COORDINATES].reshape(count, FINGERS, 2)
        if self.shift.shape[1] == JOINT_COORDINATES:  # without motion
            x: np.ndarray = np.einsum("rfij,rfj->rfi", self.inverse, on_fingers)
            return x.reshape(count, JOINT_COORDINATES)
        from_fingers = np.einsum("rfij,rfj->ri", self.through, on_fingers)
        on_object = residual[:, JOINT_COORDINATES:] - from_fingers
        x_object = np.linalg.solve(self.schur, on_object[..., None])[..., 0]
        remainder = on_fingers - np.einsum("rfij,rj->rfi", self.cross, x_object)
        x_fingers = np.einsum("rfij,rfj->rfi", self.inverse, remainder)
        return np.concatenate([x_fingers.reshape(count, JOINT_COORDINATES), x_object], axis=1)


def _slopes(contacts: Contacts) -> np.ndarray:
    """Return `slope` (C, 5) of `Balance`.

    The slope by a joint's angle is the part of hinge x arm along the normal. The slope by the
    object's position is the normal.
    """
    pose = contacts.pose
    slope = np.zeros((len(contacts.row), 5))
    slope[:, 2:] = contacts.normal
    on_link = contacts.patch < LINK_PATCHES
    row = contacts.row[on_link]
    finger, link = np.divmod(contacts.patch[on_link], LINKS_OF_FINGER)
    # n . (hinge x arm) = -arm . (hinge x n)
    spin = _cross(pose.hinge[row, finger], contacts.normal[on_link])
    joints = LINKS_OF_FINGER * finger[:, None] + np.arange(LINKS_OF_FINGER)
    # (C, 3 joints, 3)
    arm = contacts.point[on_link, None] - pose.origin[row[:, None], joints]
    moves = np.arange(LINKS_OF_FINGER) <= link[:, None]
    by_joint = np.einsum("nji,ni->nj", arm, spin) * moves
    slope[on_link, :2] = by_joint @ COUPLING
    return slope


def _sums_by_part(
    contacts: Contacts, count: int, force: np.ndarray, stiffness: np.ndarray, slope: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return sums over the contacts of each part of a hand: its five fingers and the palm.

    Contacts are sorted by hand and part, so each sum is over neighbours.

    Args:
        contacts: C contacts of R hands.
        count: R, number of hands.
        force: (C,) N, forces of the contacts.
        stiffness: (C,) N/m, their stiffness.
        slope: (C, 5) slopes of their depths.

    Returns:
        The sums (R, 6, 5) of force * slope, and (R, 6, 5, 5) of stiffness * slope slope'.
    """
    sums = np.zeros((count * PARTS, 5))
    outer = np.zeros((count * PARTS, 5, 5))
    if len(force):
        group = contacts.row * PARTS + part_of(contacts.patch)
        is_first = np.ones(len(group), dtype=bool)
        is_first[1:] = group[1:] != group[:-1]
        starts = np.flatnonzero(is_first)
        present = group[starts]
        sums[present] = np.add.reduceat(force[:, None] * slope, starts)
        weighted = (stiffness[:, None] * slope)[:, :, None]
        outer[present] = np.add.reduceat(weighted * slope[:, None, :], starts)
    return sums.reshape(count, PARTS, 5), outer.reshape(count, PARTS, 5, 5)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross products (n, 3) of vectors a and b (n, 3), faster than numpy.cross."""
    product = np.empty_like(b)
    for axis in range(3):
        following = (axis + 1) % 3
        last = (axis + 2) % 3
        product[:, axis] = a[:, following] * b[:, last] - a[:, last] * b[:, following]
    return product


def _inverse_2x2(block: np.ndarray) -> np.ndarray:
    """Return the inverses of matrices (..., 2, 2)."""
    a = block[..., 0, 0]
    b = block[..., 0, 1]
    c = block[..., 1, 0]
    d = block[..., 1, 1]
    inverse = np.empty_like(block)
    inverse[..., 0, 0] = d
    inverse[..., 0, 1] = -b
    inverse[..., 1, 0] = -c
    inverse[..., 1, 1] = a
    inverse /= (a * d - b * c)[..., None, None]
    return inverse
