"""Contact mechanics: an elastic skin in series with the object's surface; joints and object move overdamped.

The unknowns y of a hand are ten joint coordinates (5, 2) in rad and, where the object moves, its
position (3,) in m:

    D dy/dt = drive(t) - dU/dy,    U = sum_s k A_s d_s^2 / 2  +  joints  +  joint limits  +
    holding.

D is the damping, d_s the depth of sensor s inside the object, A_s its area, and k the stiffness per
area of skin and object in series (elastic or Winkler foundation: Johnson, "Contact Mechanics"
(1985), section 4.3). The force on a sensor is k A_s d_s along the object's normal. There is no
separate friction: a spring, `holding`, pulls the object to the position that the scene prescribes.
The Hessian of U omits the curvature of the contact (Gauss-Newton) and is therefore never
indefinite.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.hand import COUPLING, LINK_PATCHES, Hands, Pose
from tactile_viewgcn.glove.shapes import Solids

LIMITS = np.array([[-0.3, 1.6], [-0.1, 1.9]])  # rad: range of the two coordinates of a finger
JOINT = np.array([0.25, 0.16])  # N m / rad: springs towards the posture
LIMIT = 6.0  # N m / rad: spring beyond LIMITS
TENDON = np.array([1.0, 0.5])  # share of a finger's squeeze that acts on each of its coordinates
HOLDING = 1500.0  # N/m: spring between the object and its prescribed position
GRAVITY = 9.81  # m/s^2
LEVER = 0.05  # m: converts between forces and torques of comparable size


@dataclass(frozen=True)
class Layer:
    """Skin and glove as an elastic layer, and the damping, which decide how stiff the equation is.

    Args:
        stiffness: Pa/m of skin and glove, modulus over thickness.
        thickness: m; the integrator counts errors of positions in it.
        joint_damping: N m s / rad.
        object_damping: N s / m.
    """

    stiffness: float
    thickness: float
    joint_damping: float
    object_damping: float


@dataclass(frozen=True)
class Drive:
    """Prescribed motion and loads at K knots one frame apart, linear in between.

    Attributes:
        posture: (B, K, 5, 2) rad, zero of the joints' springs.
        squeeze: (B, K, 5) N m, torque that closes each finger.
        opposition: (B, K) rad of the thumb.
        position: (B, K, 3) m, where a spring draws the object.
        rotation: (B, K, 3) rotation vector of the object, rad.
        load: (B, K, 3) N on the object.
    """

    posture: np.ndarray
    squeeze: np.ndarray
    opposition: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    load: np.ndarray

    def at(self, rows: np.ndarray, time: np.ndarray) -> dict[str, np.ndarray]:
        """Values by name of rows (R,) at times (R,), in frames since the first knot."""
        values_at, last = {}, self.squeeze.shape[1] - 1
        knot = np.minimum(time.astype(int), last - 1)
        fraction = np.minimum(time - knot, 1.0)
        for name, values in vars(self).items():
            before, after = values[rows, knot], values[rows, knot + 1]
            weight = fraction.reshape(-1, *[1] * (before.ndim - 1))
            values_at[name] = before + weight * (after - before)
        return values_at


@dataclass(frozen=True)
class Contacts:
    """C contacts of one sensor with one primitive, sorted by row and sensor.

    Where primitives of an object overlap, a sensor has a contact with each of them, so the force on
    it changes continuously as it slides from one into the other. A sensor pressed past the middle
    of a wall is pushed out on the far side.

    Attributes:
        row: (C,) index of the hand among the rows of the search.
        sensor: (C,) index of the sensor; patch: (C,) patch that carries it.
        depth: (C,) m, above 0.
        normal: (C, 3) unit vector out of the object.
        point: (C, 3) m, position of the sensor.
    """

    row: np.ndarray
    sensor: np.ndarray
    patch: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    point: np.ndarray


@dataclass(frozen=True)
class Balance:
    """Forces, energy and Hessian of R hands at one state.

    Attributes:
        residual: (R, n) dU/dy - drive; 0 in equilibrium.
        energy: (R,) J, U - drive . y.
        fingers: (R, 5, 2, 2) the Hessian's blocks of the fingers.
        cross: (R, 5, 2, 3) its blocks between fingers and object.
        object: (R, 3, 3) its block of the object; (R, 0, 0) without motion.
        contacts: the C contacts.
        force: (C,) N along the contact's normal.
        slope: (C, 5) derivative of the depth by the two coordinates of the sensor's finger and the
            object's three.
        facing: (C,) cosine between the sensor's normal and the direction of the pressure, at least
            0.
    """

    residual: np.ndarray
    energy: np.ndarray
    fingers: np.ndarray
    cross: np.ndarray
    object: np.ndarray
    contacts: Contacts
    force: np.ndarray
    slope: np.ndarray
    facing: np.ndarray


class Mechanics:
    """The differential equation of B hands.

    Args:
        hands, solids: B hands and objects.
        stiffness: (B,) Pa/m of the objects' surfaces.
        drive: prescribed motion and loads.
        layer: skin and damping.
        motion: whether the object's position is unknown too; n is 13 then, else 10.
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
        self.hands, self.solids, self.drive, self.layer, self.motion = (
            hands,
            solids,
            drive,
            layer,
            motion,
        )
        # in series
        self.stiffness = 1 / (1 / layer.stiffness + 1 / np.asarray(stiffness, dtype=float))
        self.size = 13 if motion else 10
        self.damping = np.full(self.size, layer.joint_damping)
        self.damping[10:] = layer.object_damping
        # makes torques on joints and forces on the object comparable
        self.lever = np.ones(self.size)
        self.lever[10:] = LEVER

    def initial_state(self) -> np.ndarray:
        """States (B, n) in the prescribed posture and position of the first knot."""
        y = np.zeros((len(self.stiffness), self.size))
        y[:, :10] = self.drive.posture[:, 0].reshape(-1, 10)
        if self.motion:
            y[:, 10:] = self.drive.position[:, 0]
        return y

    def evaluate(self, rows: np.ndarray, time: np.ndarray, y: np.ndarray, *, palm: bool) -> Balance:
        """Forces, energy and Hessian of rows (R,) at times (R,) in frames and states y (R, n).

        `palm`: whether the palm's sensors are tested for contact; their forces matter only where
        the object moves.
        """
        now = self.drive.at(rows, time)
        q, count = y[:, :10].reshape(-1, 5, 2), len(rows)
        position = y[:, 10:] if self.motion else now["position"]
        contacts, slope, facing = self._contacts(rows, q, position, now, palm=palm)
        sensor = rows[contacts.row], contacts.sensor
        stiffness = self.stiffness[sensor[0]] * self.hands.area[sensor]  # N/m
        force = stiffness * contacts.depth
        # Sums by hand and by finger or palm of force * slope and of stiffness * slope slope';
        # contacts are sorted so.
        sums, outer = np.zeros((count * 6, 5)), np.zeros((count * 6, 5, 5))
        if len(force):
            group = contacts.row * 6 + np.minimum(contacts.patch // 3, 5)
            present, starts = np.unique(group, return_index=True)
            sums[present] = np.add.reduceat(force[:, None] * slope, starts)
            outer[present] = np.add.reduceat(
                (stiffness[:, None] * slope)[:, :, None] * slope[:, None, :], starts
            )
        gradient, blocks = sums.reshape(count, 6, 5), outer.reshape(count, 6, 5, 5)
        residual = np.zeros((count, self.size))
        bend = q - now["posture"]
        beyond = q - np.clip(q, LIMITS[:, 0], LIMITS[:, 1])
        torque = now["squeeze"][..., None] * TENDON
        residual[:, :10] = (JOINT * bend + LIMIT * beyond + gradient[:, :5, :2] - torque).reshape(
            count, 10
        )
        energy = 0.5 * (JOINT * bend**2 + LIMIT * beyond**2).sum(axis=(1, 2)) - (torque * q).sum(
            axis=(1, 2)
        )
        energy += 0.5 * np.bincount(contacts.row, force * contacts.depth, count)
        fingers = blocks[:, :5, :2, :2].copy()
        fingers[..., [0, 1], [0, 1]] += JOINT + LIMIT * (beyond != 0)
        on_object = np.empty((count, 0, 0))
        if self.motion:
            on_object = blocks[:, :, 2:, 2:].sum(axis=1) + HOLDING * np.eye(3)
            offset = position - now["position"]
            residual[:, 10:] = HOLDING * offset + gradient[:, :, 2:].sum(axis=1) - now["load"]
            energy += 0.5 * HOLDING * (offset**2).sum(axis=1) - (now["load"] * position).sum(axis=1)
        return Balance(
            residual,
            energy,
            fingers,
            blocks[:, :5, :2, 2:],
            on_object,
            contacts,
            force,
            slope,
            facing,
        )

    def _contacts(
        self,
        rows: np.ndarray,
        q: np.ndarray,
        position: np.ndarray,
        now: dict[str, np.ndarray],
        *,
        palm: bool,
    ) -> tuple[Contacts, np.ndarray, np.ndarray]:
        """Contacts, with `slope` (C, 5) and `facing` (C,) of `Balance`.

        The slope by a joint's angle is hinge x arm along the normal; by the object's position it is
        the normal.
        """
        pose = self.hands.pose(rows, q, now["opposition"])
        rotation = Rotation.from_rotvec(now["rotation"]).as_matrix()
        contacts = collisions(self.hands, self.solids, rows, pose, position, rotation, palm=palm)
        local = self.hands.normal[rows[contacts.row], contacts.sensor]
        skin = np.einsum("nij,nj->ni", pose.axes[contacts.row, contacts.patch], local)
        facing = np.maximum(-np.einsum("ni,ni->n", skin, contacts.normal), 0)
        slope = np.zeros((len(contacts.row), 5))
        slope[:, 2:] = contacts.normal
        on = contacts.patch < LINK_PATCHES
        r, finger, link = contacts.row[on], contacts.patch[on] // 3, contacts.patch[on] % 3
        # n . (hinge x arm) = -arm . (hinge x n)
        spin = np.cross(pose.hinge[r, finger], contacts.normal[on])
        # (C, 3 joints, 3)
        arm = contacts.point[on, None] - pose.origin[r[:, None], 3 * finger[:, None] + np.arange(3)]
        by_joint = np.einsum("nji,ni->nj", arm, spin) * (np.arange(3) <= link[:, None])
        slope[on, :2] = by_joint @ COUPLING
        return contacts, slope, facing

    def force_change(self, balance: Balance, rows: np.ndarray, dy: np.ndarray) -> np.ndarray:
        """Change (C,) N of the contacts' forces for a change dy (R, n) of the state, to first order."""
        row, finger = balance.contacts.row, np.minimum(balance.contacts.patch // 3, 4)
        deeper = np.einsum(
            "ni,ni->n", balance.slope[:, :2], dy[:, :10].reshape(-1, 5, 2)[row, finger]
        )
        if self.motion:
            deeper += np.einsum("ni,ni->n", balance.slope[:, 2:], dy[row, 10:])
        return (
            self.stiffness[rows[row]] * self.hands.area[rows[row], balance.contacts.sensor] * deeper
        )

    def solve(self, balance: Balance, shift: np.ndarray, residual: np.ndarray) -> np.ndarray:
        """Solution x (R, n) of (Hessian + diag(shift)) x = residual, for shift and residual (R, n).

        The fingers are coupled only through the object, so a 3 x 3 Schur complement is solved, then
        each finger.
        """
        count = len(residual)
        block = balance.fingers.copy()
        block[..., [0, 1], [0, 1]] += shift[:, :10].reshape(count, 5, 2)
        a, b, c, d = block[..., 0, 0], block[..., 0, 1], block[..., 1, 0], block[..., 1, 1]
        inverse = (
            np.stack([d, -b, -c, a], axis=-1).reshape(block.shape)
            / (a * d - b * c)[..., None, None]
        )
        on_fingers = residual[:, :10].reshape(count, 5, 2)
        if not self.motion:
            return np.einsum("rfij,rfj->rfi", inverse, on_fingers).reshape(count, 10)
        through = np.einsum("rfji,rfjk->rfik", balance.cross, inverse)  # (R, 5, 3, 2)
        schur = balance.object - np.einsum("rfij,rfjk->rik", through, balance.cross)
        schur[:, [0, 1, 2], [0, 1, 2]] += shift[:, 10:]
        on_object = residual[:, 10:] - np.einsum("rfij,rfj->ri", through, on_fingers)
        x_object = np.linalg.solve(schur, on_object[..., None])[..., 0]
        remainder = on_fingers - np.einsum("rfij,rj->rfi", balance.cross, x_object)
        x_fingers = np.einsum("rfij,rfj->rfi", inverse, remainder).reshape(count, 10)
        return np.concatenate([x_fingers, x_object], axis=1)


def collisions(
    hands: Hands, solids: Solids, rows: np.ndarray, pose: Pose, position: np.ndarray, rotation: np.ndarray, *,
    palm: bool,
) -> Contacts:  # fmt: skip
    """Contacts of the hands `rows` with their objects.

    Pairs of patch and primitive whose bounding spheres do not overlap are skipped.

    Args:
        hands, solids: B hands and the B objects that they hold.
        rows: (R,) indices of R of these hands.
        pose: pose of the R hands.
        position: (R, 3) m of the objects; rotation: (R, 3, 3) from the object's axes to the palm's.
        palm: whether the palm's sensors are tested too.
    """
    patches = len(hands.start) if palm else LINK_PATCHES
    # Centres of the bounding spheres of primitives (R, P, 3) and patches (R, N, 3).
    primitive = position[:, None] + np.einsum("rij,rpj->rpi", rotation, solids.centre[rows])
    patch = pose.origin[:, :patches] + np.einsum(
        "rnij,rnj->rni", pose.axes[:, :patches], hands.centre[rows, :patches]
    )
    # (R, N, P)
    squared = sum((patch[:, :, None, axis] - primitive[:, None, :, axis]) ** 2 for axis in range(3))
    radii = hands.bounding_radius[:patches, None] + solids.bounding_radius[rows][:, None]
    r, n, p = np.nonzero(squared < np.maximum(radii, 0) ** 2)
    axes = rotation[r] @ solids.rotation[rows[r], p]
    local = np.einsum("nij,ni->nj", axes, patch[r, n] - primitive[r, p])
    close = solids.distance(rows[r], p, local) < hands.bounding_radius[n]
    r, n, p, axes = r[close], n[close], p[close], axes[close]

    # One entry for each sensor of the remaining pairs, first in the primitive's axes.
    offset = np.einsum("nij,ni->nj", axes, pose.origin[r, n] - primitive[r, p])
    turn = axes.swapaxes(1, 2) @ pose.axes[r, n]
    count = hands.count[n]
    first = np.repeat(hands.start[n] - np.cumsum(count) + count, count)
    pair = np.repeat(np.arange(len(r)), count)
    sensor = first + np.arange(len(pair))
    local = offset[pair] + np.einsum("nij,nj->ni", turn[pair], hands.local[rows[r[pair]], sensor])
    distance = solids.distance(rows[r[pair]], p[pair], local)
    inside = np.flatnonzero(distance < 0)
    inside = inside[np.argsort(r[pair[inside]] * len(hands.patch) + sensor[inside], kind="stable")]
    pair, sensor, local = pair[inside], sensor[inside], local[inside]
    r, n, p, axes = r[pair], n[pair], p[pair], axes[pair]
    normal = np.einsum("nij,nj->ni", axes, solids.gradient(rows[r], p, local))
    point = primitive[r, p] + np.einsum("nij,nj->ni", axes, local)
    return Contacts(r, sensor, n, -distance[inside], normal, point)
