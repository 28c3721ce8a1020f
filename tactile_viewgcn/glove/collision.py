"""Collision detection: the sensors that are inside an object."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.glove.hand import LINK_PATCHES, Hands, Pose
from tactile_viewgcn.glove.shapes import Solids


@dataclass(frozen=True)
class Contacts:
    """C contacts of one sensor with one primitive, sorted by row and sensor.

    Where primitives of an object overlap, a sensor has a contact with each of them, so the force on it changes
    continuously as it slides from one into the other. A sensor pressed past the middle of a wall is pushed out on the
    far side.

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
    patch = pose.origin[:, :patches] + np.einsum("rnij,rnj->rni", pose.axes[:, :patches], hands.centre[rows, :patches])
    squared = sum((patch[:, :, None, axis] - primitive[:, None, :, axis]) ** 2 for axis in range(3))  # (R, N, P)
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
