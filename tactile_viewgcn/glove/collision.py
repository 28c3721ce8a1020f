"""Collision detection: the sensors that are inside an object, and objects that pass through a finger within a step.

The second is called tunnelling. Without contact the equation is linear and its steps are long. The integrator knows the
contacts at the stages of a step alone, and a Newton iteration may jump over one. So the straight path between the two
states of a step is sampled before the step is accepted, if the path is longer than a finger's thickness or the inradius
of the object's thinnest part.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_viewgcn.glove.hand import COUPLING, LINK_PATCHES, RADIUS, Hands, Pose
from tactile_viewgcn.glove.shapes import Solids

if TYPE_CHECKING:
    from tactile_viewgcn.glove.contact import Mechanics

SAMPLE_DISTANCE = 2 * RADIUS  # m, largest distance of two samples of a path: the thickness of a finger
MAX_SAMPLES = 64  # samples of one path


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


def tunnels(
    mechanics: "Mechanics", rows: np.ndarray, begin: np.ndarray, before: np.ndarray, end: np.ndarray, after: np.ndarray
) -> tuple[np.ndarray, int]:
    """Whether a finger or the palm passes through the object on the straight path between two states.

    It does where the depth along the path exceeds the depth at both ends by more than the distance from a finger's
    skin to its bone, or by more than half of the inradius of the object's thinnest part. Shallower contacts may be
    passed.

    Args:
        rows: (R,) the hands.
        begin, end: (R,) times in frames.
        before, after: (R, n) states.

    Returns:
        (R,) bool, and the number of states that were evaluated.
    """
    spacing = np.minimum(SAMPLE_DISTANCE, mechanics.solids.inradius[rows])
    intervals = np.ceil(_path_length(mechanics, rows, begin, before, end, after) / spacing)
    samples = np.where(intervals < 2, 0, np.minimum(intervals, MAX_SAMPLES) + 1).astype(int)
    path = np.repeat(np.arange(len(rows)), samples)
    if not len(path):
        return np.zeros(len(rows), dtype=bool), 0
    number = np.arange(len(path)) - np.repeat(np.cumsum(samples) - samples, samples)
    fraction = number / (samples[path] - 1)
    time = begin[path] + fraction * (end - begin)[path]
    y = before[path] + fraction[:, None] * (after - before)[path]
    contacts = mechanics.evaluate(rows[path], time, y, palm=mechanics.motion).contacts
    hand_part = path[contacts.row], np.minimum(contacts.patch // 3, 5)  # hand, and finger or palm
    between = (fraction[contacts.row] > 0) & (fraction[contacts.row] < 1)
    depth_at_ends, depth_between = np.zeros((2, len(rows), 6))
    np.maximum.at(depth_at_ends, tuple(index[~between] for index in hand_part), contacts.depth[~between])
    np.maximum.at(depth_between, tuple(index[between] for index in hand_part), contacts.depth[between])
    allowed = np.minimum(RADIUS, 0.5 * mechanics.solids.inradius[rows])
    return (depth_between - depth_at_ends > allowed[:, None]).any(axis=1), len(path)


def _path_length(
    mechanics: "Mechanics", rows: np.ndarray, begin: np.ndarray, before: np.ndarray, end: np.ndarray, after: np.ndarray
) -> np.ndarray:
    """Upper bound (R,) m of the movement of the object and a fingertip relative to each other; 0 without an object."""
    first, last = mechanics.drive.at(rows, begin), mechanics.drive.at(rows, end)
    hands, solids = mechanics.hands, mechanics.solids
    moved = after[:, 10:] - before[:, 10:] if mechanics.motion else last["position"] - first["position"]
    radius = np.linalg.norm(solids.centre[rows], axis=-1) + solids.bounding_radius[rows]
    radius = np.maximum(radius, 0).max(axis=1, initial=0)
    rotated = radius * np.linalg.norm(last["rotation"] - first["rotation"], axis=-1)
    bent = np.abs((after - before)[:, :10].reshape(-1, 5, 2)) @ COUPLING.sum(axis=0)
    bent += np.abs(last["opposition"] - first["opposition"])[:, None]
    tips = (hands.links[rows].sum(axis=-1) * bent).max(axis=1)
    return np.where(radius > 0, np.linalg.norm(moved, axis=-1) + rotated + tips, 0.0)
