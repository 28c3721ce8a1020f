"""Which sensors are inside an object, and how deep."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.glove.hand import LINK_PATCHES, Hands, Pose
from tactile_viewgcn.glove.shapes import Solids


@dataclass(frozen=True)
class Contacts:
    """Sensors inside an object, C entries in the order of row and sensor.

    Where primitives of an object overlap, each counts: a sensor in the groove between two is pressed by both, so that
    the forces stay continuous up to half of a wall: a sensor that is pressed past it comes out behind.

    Attributes:
        row: (C,) among the rows asked for; sensor: (C,); patch: (C,) that carries it.
        depth: (C,) m, above 0.
        normal: (C, 3) out of the object; point: (C, 3) m, where the sensor is.
    """

    row: np.ndarray
    sensor: np.ndarray
    patch: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    point: np.ndarray


_NONE = np.zeros(0, dtype=int)
NO_CONTACTS = Contacts(_NONE, _NONE, _NONE, np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))


def touching(
    hands: Hands, solids: Solids, rows: np.ndarray, pose: Pose, place: np.ndarray, turn: np.ndarray, *, palm: bool
) -> Contacts:
    """Which sensors of hands `rows` (R,) are inside their objects, placed at (R, 3) m and turned by (R, 3, 3).

    Patches and primitives whose bounding spheres are apart are not looked at.
    """
    patches = len(hands.start) if palm else LINK_PATCHES
    middle = place[:, None] + np.einsum("rij,rpj->rpi", turn, solids.centre[rows])
    ball = pose.origin[:, :patches] + np.einsum("rnij,rnj->rni", pose.axes[:, :patches], hands.centre[rows, :patches])
    far = sum((ball[:, :, None, axis] - middle[:, None, :, axis]) ** 2 for axis in range(3))  # (R, N, P)
    r, n, p = np.nonzero(far < np.maximum(hands.reach[:patches, None] + solids.reach[rows][:, None], 0) ** 2)
    turns = turn[r] @ solids.turn[rows[r], p]
    own = np.einsum("nij,ni->nj", turns, ball[r, n] - middle[r, p])
    close = solids.distance(rows[r], p, own) < hands.reach[n]
    r, n, p, turns = r[close], n[close], p[close], turns[close]
    count = hands.count[n]
    first = np.repeat(hands.start[n] - np.cumsum(count) + count, count)
    pair = np.repeat(np.arange(len(r)), count)
    r, n, p, turns = r[pair], n[pair], p[pair], turns[pair]
    sensor = first + np.arange(len(r))
    point = pose.origin[r, n] + np.einsum("nij,nj->ni", pose.axes[r, n], hands.local[rows[r], sensor])
    own = np.einsum("nij,ni->nj", turns, point - middle[r, p])
    distance = solids.distance(rows[r], p, own)
    inside = np.flatnonzero(distance < 0)
    inside = inside[np.argsort(r[inside] * len(hands.patch) + sensor[inside], kind="stable")]
    r, p, own = r[inside], p[inside], own[inside]
    normal = np.einsum("nij,nj->ni", turns[inside], solids.gradient(rows[r], p, own))
    return Contacts(r, sensor[inside], n[inside], -distance[inside], normal, point[inside])
