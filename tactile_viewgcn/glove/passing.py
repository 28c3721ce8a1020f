"""Contacts that a step passes by: a finger is on one side of an object before, and on the other side after it.

Without contact the equation is linear and its steps are long, and a method that looks at two moments of a step cannot
know of a third; nor does a Newton iteration see what it jumps over. So the way of a step is looked at as well, before
it is kept, where it is longer than a finger is thick or than the inradius of the object's thinnest part. A touch is let
pass that comes neither as deep as a finger's bone nor half the way to the middle of that part.
"""

import numpy as np

from tactile_viewgcn.glove.contact import Mechanics
from tactile_viewgcn.glove.hand import COUPLING, RADIUS

LOOK, MOST = 2 * RADIUS, 64  # m of way from one look to the next, a finger's thickness at most; looks at one way


def passed(
    mechanics: Mechanics, rows: np.ndarray, begin: np.ndarray, before: np.ndarray, end: np.ndarray, after: np.ndarray
) -> tuple[np.ndarray, int]:
    """Whether a finger or palm of hands (R,) and the object go through each other on the straight way between states.

    They do where they are deeper in each other than at both ends, by more than a bone lies below its skin, or by half
    of the inradius of the object's thinnest part.

    Args:
        rows: the hands; begin, end: (R,) times in frames; before, after: (R, n) states.

    Returns:
        (R,) bool, and how many states were looked at.
    """
    apart = np.minimum(LOOK, mechanics.solids.inradius[rows])
    parts = np.ceil(_way(mechanics, rows, begin, before, end, after) / apart)
    looks = np.where(parts < 2, 0, np.minimum(parts, MOST) + 1).astype(int)
    which = np.repeat(np.arange(len(rows)), looks)
    if not len(which):
        return np.zeros(len(rows), dtype=bool), 0
    number = np.arange(len(which)) - np.repeat(np.cumsum(looks) - looks, looks)
    share = number / (looks[which] - 1)
    time = begin[which] + share * (end - begin)[which]
    y = before[which] + share[:, None] * (after - before)[which]
    touch = mechanics.balance(rows[which], time, y, palm=mechanics.motion).contacts
    at = which[touch.row], np.minimum(touch.patch // 3, 5)  # hand, and finger or palm
    between = (share[touch.row] > 0) & (share[touch.row] < 1)
    ends, inner = np.zeros((2, len(rows), 6))
    np.maximum.at(ends, tuple(part[~between] for part in at), touch.depth[~between])
    np.maximum.at(inner, tuple(part[between] for part in at), touch.depth[between])
    deep = np.minimum(RADIUS, 0.5 * mechanics.solids.inradius[rows])
    return (inner - ends > deep[:, None]).any(axis=1), len(which)


def _way(
    mechanics: Mechanics, rows: np.ndarray, begin: np.ndarray, before: np.ndarray, end: np.ndarray, after: np.ndarray
) -> np.ndarray:
    """(R,) m that the object and a fingertip move towards each other, at most; 0 where there is no object."""
    first, last = mechanics.drive.at(rows, begin), mechanics.drive.at(rows, end)
    hands, solids = mechanics.hands, mechanics.solids
    moved = after[:, 10:] - before[:, 10:] if mechanics.motion else last["place"] - first["place"]
    size = np.maximum(np.linalg.norm(solids.centre[rows], axis=-1) + solids.reach[rows], 0).max(axis=1, initial=0)
    turned = size * np.linalg.norm(last["turn"] - first["turn"], axis=-1)
    bent = np.abs((after - before)[:, :10].reshape(-1, 5, 2)) @ COUPLING.sum(axis=0)
    bent += np.abs(last["opposition"] - first["opposition"])[:, None]
    tips = (hands.links[rows].sum(axis=-1) * bent).max(axis=1)
    return np.where(size > 0, np.linalg.norm(moved, axis=-1) + turned + tips, 0.0)
