"""The search for contacts: which sensors of a hand lie inside which primitives of its object."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_viewgcn.glove.hand import LINK_PATCHES, Hands, Pose
from tactile_viewgcn.glove.shapes import Solids

ROUNDING = 1e-9  # m: more than the rounding errors of a distance


@dataclass(frozen=True)
class Contacts:
    """C contacts, each of one sensor with one primitive, sorted by row and sensor.

    If primitives of an object overlap, a sensor inside both has a contact with each. So the force
    on it changes continuously as it slides from one into the other. A sensor that is pressed past
    the middle of a wall is pushed out on the far side.

    Attributes:
        row: (C,) index of the hand among the rows of the search.
        sensor: (C,) index of the sensor.
        patch: (C,) patch that carries the sensor.
        depth: (C,) m, above 0.
        local: (C, 3) m, position of the sensor in the primitive's axes.
        centre: (C, 3) m, centre of the primitive.
        axes: (C, 3, 3) axes of the primitive.
        primitive: (C,) index of the primitive in its object.
        hand: (C,) index of the hand among all hands, and of its object among all objects.
        hands: all hands.
        solids: all objects.
        pose: pose of the hands of the search.
    """

    row: np.ndarray
    sensor: np.ndarray
    patch: np.ndarray
    depth: np.ndarray
    local: np.ndarray
    centre: np.ndarray
    axes: np.ndarray
    primitive: np.ndarray
    hand: np.ndarray
    hands: Hands
    solids: Solids
    pose: Pose

    @cached_property
    def normal(self) -> np.ndarray:
        """Return the unit vectors (C, 3) out of the object; the search for tunnels needs none."""
        gradient = self.solids.gradient(self.hand, self.primitive, self.local)
        normal: np.ndarray = np.einsum("nij,nj->ni", self.axes, gradient)
        return normal

    @cached_property
    def point(self) -> np.ndarray:
        """Return the positions (C, 3) m of the sensors."""
        point: np.ndarray = self.centre + np.einsum("nij,nj->ni", self.axes, self.local)
        return point

    @cached_property
    def facing(self) -> np.ndarray:
        """Return the cosines (C,) between the sensors' normals and the pressure, at least 0."""
        of_sensor = self.hands.normal[self.hand, self.sensor]
        skin = np.einsum("nij,nj->ni", self.pose.axes[self.row, self.patch], of_sensor)
        facing: np.ndarray = np.maximum(-np.einsum("ni,ni->n", skin, self.normal), 0)
        return facing


def collisions(
    hands: Hands,
    solids: Solids,
    rows: np.ndarray,
    pose: Pose,
    position: np.ndarray,
    rotation: np.ndarray,
    *,
    palm: bool,
) -> Contacts:
    """Return the contacts of some hands with their objects.

    Pairs of a patch and a primitive whose bounding spheres do not overlap are skipped.

    Args:
        hands: B hands.
        solids: the B objects that they hold.
        rows: (R,) indices of R of these hands.
        pose: pose of the R hands.
        position: (R, 3) m, positions of the objects.
        rotation: (R, 3, 3) rotations from the object's axes to the palm's.
        palm: whether the palm's sensors are tested too.
    """
    # centres of the bounding spheres of primitives (R, P, 3)
    primitive = position[:, None] + np.einsum("rij,rpj->rpi", rotation, solids.centre[rows])
    patches = LINK_PATCHES
    if palm:
        patches = len(hands.start)
    # indices (n,) of hand, patch and primitive of each close pair, the primitive's axes, and its
    # distance from the patch's centre
    r, n, p, axes, gap = _close_pairs(hands, solids, rows, pose, primitive, rotation, patches)

    # One entry for each sensor of the remaining pairs, first in the primitive's axes.
    offset = np.einsum("nij,ni->nj", axes, pose.origin[r, n] - primitive[r, p])
    turn = axes.swapaxes(1, 2) @ pose.axes[r, n]
    count = hands.count[n]
    first = np.repeat(hands.start[n] - np.cumsum(count) + count, count)
    pair = np.repeat(np.arange(len(r)), count)
    sensor = first + np.arange(len(pair))
    hand = rows[r]
    # index of a sensor among the sensors of all hands
    number = hand[pair] * len(hands.patch) + sensor
    # A sensor can be deeper than its patch's centre only by its distance from the centre.
    may_touch = np.flatnonzero(gap[pair] < hands.from_centre.take(number) + ROUNDING)
    pair = pair[may_touch]
    sensor = sensor[may_touch]
    of_sensor = hands.local.reshape(-1, 3).take(number[may_touch], axis=0)
    local = offset[pair] + np.einsum("nij,nj->ni", turn[pair], of_sensor)
    distance = solids.distance(hand[pair], p[pair], local)
    inside = np.flatnonzero(distance < 0)
    by_row_and_sensor = r[pair[inside]] * len(hands.patch) + sensor[inside]
    inside = inside[np.argsort(by_row_and_sensor, kind="stable")]
    pair = pair[inside]
    r = r[pair]
    n = n[pair]
    p = p[pair]
    return Contacts(
        row=r,
        sensor=sensor[inside],
        patch=n,
        depth=-distance[inside],
        local=local[inside],
        centre=primitive[r, p],
        axes=axes[pair],
        primitive=p,
        hand=hand[pair],
        hands=hands,
        solids=solids,
        pose=pose,
    )


def _close_pairs(
    hands: Hands,
    solids: Solids,
    rows: np.ndarray,
    pose: Pose,
    primitive: np.ndarray,
    rotation: np.ndarray,
    patches: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the pairs of a patch and a primitive that can be in contact.

    The bounding spheres of a pair overlap, and the patch's sphere reaches into the primitive.

    Args:
        hands: B hands.
        solids: the B objects that they hold.
        rows: (R,) indices of R of these hands.
        pose: pose of the R hands.
        primitive: (R, P, 3) m, centres of the primitives' spheres.
        rotation: (R, 3, 3) rotations from the object's axes to the palm's.
        patches: N, number of patches that are tested.

    Returns:
        Indices of hand, patch and primitive, (n,) each; the axes (n, 3, 3) of the primitives; and
        the signed distances (n,) m of the patches' centres from the primitives.
    """
    # centres of the bounding spheres of patches (R, N, 3)
    patch = pose.origin[:, :patches] + np.einsum(
        "rnij,rnj->rni", pose.axes[:, :patches], hands.centre[rows, :patches]
    )
    # (R, N, P)
    squared = sum((patch[:, :, None, axis] - primitive[:, None, :, axis]) ** 2 for axis in range(3))
    radii = hands.bounding_radius[:patches, None] + solids.bounding_radius[rows][:, None]
    r, n, p = np.nonzero(squared < np.maximum(radii, 0) ** 2)
    axes = rotation[r] @ solids.rotation[rows[r], p]
    local = np.einsum("nij,ni->nj", axes, patch[r, n] - primitive[r, p])
    gap = solids.distance(rows[r], p, local)
    is_close = gap < hands.bounding_radius[n]
    return r[is_close], n[is_close], p[is_close], axes[is_close], gap[is_close]
