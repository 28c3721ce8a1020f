"""Tunnelling: objects that pass through a finger within a step of the integrator.

Without contact the equation is linear and its steps are long. The integrator knows the contacts at the stages of a step
alone, and a Newton iteration may jump over one. So the straight path between the two states of a step is sampled before
the step is accepted, if the path is longer than a finger's thickness or the inradius of the object's thinnest part.
"""

import numpy as np

from tactile_viewgcn.glove.contact import Mechanics
from tactile_viewgcn.glove.hand import COUPLING, RADIUS

SAMPLE_DISTANCE = 2 * RADIUS  # m, largest distance of two samples of a path: the thickness of a finger
MAX_SAMPLES = 64  # samples of one path


def tunnels(
    mechanics: Mechanics, rows: np.ndarray, begin: np.ndarray, before: np.ndarray, end: np.ndarray, after: np.ndarray
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
    mechanics: Mechanics, rows: np.ndarray, begin: np.ndarray, before: np.ndarray, end: np.ndarray, after: np.ndarray
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
