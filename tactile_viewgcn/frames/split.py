"""Train, validation and test sides, by groups of frames that belong together, and anchors on each side.

Frames of one recording resemble each other far more than frames of two, so all frames of a group (a recording, a
grasp, a session) are on one side. The published split is the exception: its sides are used as they are, and the
number of recordings on both of them is reported.
"""

import numpy as np

from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import SIDES, TEST, TRAIN, VALIDATION

MINIMUM = 100  # anchors that a class keeps at least; a class with fewer frames uses all of them
SPLIT_SEED = 0  # of anchors and validation groups, so that these are the same for every value of `seed`


def split_groups(columns: dict[str, np.ndarray], by: str) -> np.ndarray:
    """Split group int64 (T,) of each frame from its columns (T,), numbered in the order of the recordings.

    A recording of several objects is a group per object. With `source` the recordings are the groups.

    Raises:
        UserError: `grasp` or `source`, and the recordings have no such column.
    """
    column = {"grasp": "grasp", "source": "split"}.get(by)
    if column and column not in columns:
        what = "grasp numbers" if by == "grasp" else "published split"
        remedy = ", and split.train_grasps to all" * (by == "grasp")
        raise UserError(f"the recordings have no {what}: set split.by to recording or session{remedy}")
    if by == "session":
        return columns["session"].astype(np.int64)
    keys = [columns["recording"], columns["object"]] + ([columns["grasp"]] if by == "grasp" else [])
    return np.unique(np.stack(keys, axis=1), axis=0, return_inverse=True)[1].ravel()


def spans_classes(groups: np.ndarray, labels: np.ndarray) -> bool:
    """Whether a split group (n,) has frames of several classes (n,), as a session has."""
    return len(np.unique(np.stack([groups, labels]), axis=1).T) > len(np.unique(groups))


def fold_sides(
    groups: np.ndarray,
    labels: np.ndarray,
    *,
    folds: int,
    fold: int,
    across: bool,
    deal: int = 0,
) -> np.ndarray:
    """TRAIN or TEST, int8 (T,): the i-th group of a class is on the test side if i modulo `folds` is `fold`.

    A class of one group cannot be tested and is on the training side: others can be mistaken for it.

    Args:
        groups: (T,) split groups.
        labels: (T,) classes; the groups of each class are counted by themselves.
        across: groups span classes, as sessions do, and are counted once for all classes.
        deal: 0 counts the groups in their order; any other number in a random order, the same for all folds.
    """
    side = np.full(len(groups), TRAIN, dtype=np.int8)
    for label, of_class in _classes(labels, across):
        order = np.unique(groups[of_class])
        if len(order) == 1 and not across:
            continue
        if deal:
            order = stream(deal, "split.deal", *([] if across else [label])).permutation(order)
        side[of_class & np.isin(groups, order[fold::folds])] = TEST
    return side


def surplus_groups(side: np.ndarray, groups: np.ndarray, labels: np.ndarray, *, most: int) -> np.ndarray:
    """bool (T,): training frames of a class, or of a recording in its place, outside its first `most` groups."""
    surplus = np.zeros(len(side), dtype=bool)
    for _, of_class in _classes(labels):
        trained = of_class & (side == TRAIN)
        surplus |= trained & ~np.isin(groups, np.unique(groups[trained])[:most])
    return surplus


def validation_sides(
    side: np.ndarray, groups: np.ndarray, labels: np.ndarray, *, share: float, across: bool, rng: np.random.Generator
) -> np.ndarray:
    """Copy of `side` (T,) with a share of each class's training groups, drawn at random, as VALIDATION.

    A class with two groups or more gives at least one and keeps at least one.
    """
    side = side.copy()
    if share == 0:
        return side
    for _, of_class in _classes(labels, across):
        trained = of_class & (side == TRAIN)
        candidates = np.unique(groups[trained])
        count = min(len(candidates) - 1, max(1, round(share * len(candidates))))
        if count > 0:
            side[trained & np.isin(groups, rng.permutation(candidates)[:count])] = VALIDATION
    return side


def published_anchors(balanced: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Copy of the source's balanced frames bool (n,), as anchors.

    Raises:
        UserError: a side (n,) without any.
    """
    for code in np.unique(side):
        if not (balanced & (side == code)).any():
            raise UserError(
                f"the {SIDES[code]} side of split.by source has no balanced frames (isBalanced) that pass the "
                "filter; expected some: set preprocess.filter to contact or choose another split.by"
            )
    return balanced.copy()


def balanced_anchors(
    labels: np.ndarray, side: np.ndarray, *, rng: np.random.Generator, minimum: int = MINIMUM
) -> tuple[np.ndarray, list[Note]]:
    """Anchors bool (T,), drawn at random, equally many of every class on a side; and notes on classes with fewer.

    Their number is that of the smallest class's frames, but at least `minimum`, so that one small class does not reduce
    all others to a handful. A class with fewer frames than that uses all of them.
    """
    anchor, notes = np.zeros(len(labels), dtype=bool), []
    for code, name in enumerate(SIDES):
        of_class = [np.flatnonzero((labels == label) & (side == code)) for label in np.unique(labels)]
        sizes = [len(index) for index in of_class if len(index)]
        if not sizes:
            continue
        count = max(min(sizes), minimum)
        for index in of_class:
            anchor[rng.permutation(index)[:count]] = True
        if smaller := sum(size < count for size in sizes):
            text = (
                f"{smaller} of {several(len(sizes), 'class', 'classes')}: fewer than {several(count, 'anchor')}, so "
                f"all frames are used, {min(sizes)} in the smallest"
            )
            notes.append(Note(text, topic=f"{'training' if name == 'train' else name} side"))
    return anchor, notes


def _classes(labels: np.ndarray, across: bool = False) -> list[tuple[int, np.ndarray]]:
    """Each class and its frames bool (T,); with `across` all frames at once."""
    labels = np.zeros_like(labels) if across else labels
    return [(int(label), labels == label) for label in np.unique(labels)]
