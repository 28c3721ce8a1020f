"""Train, validation and test sides, by groups of frames that belong together. Never by frame.

Frames of one recording resemble each other far more than frames of two, so a group (a recording, a grasp, a
session) stands on one side as a whole. The published split is the exception: its own sides are taken as they
are, and how many recordings it shares between them is reported.
"""

import numpy as np

TRAIN, VALIDATION, TEST = 0, 1, 2
SIDES = ("train", "validation", "test")


def split_groups(columns: dict[str, np.ndarray], by: str) -> np.ndarray:
    """int64 (T,): the split group of each frame, from its columns (T,), numbered in the order of the recordings.

    A recording of several objects is a group per object. With `source` the recordings are the groups.

    Raises:
        ValueError: `grasp` or `source` where the recordings do not carry it.
    """
    needed = {"grasp": "grasp", "source": "split"}.get(by)
    if needed and needed not in columns:
        what = "grasp numbers" if by == "grasp" else "published split"
        raise ValueError(f"the recordings have no {what}; split.by {by} needs it: set split.by to recording or session")
    if by == "session":
        return columns["session"].astype(np.int64)
    keys = [columns["recording"], columns["object"]] + ([columns["grasp"]] if by == "grasp" else [])
    return np.unique(np.stack(keys, axis=1), axis=0, return_inverse=True)[1].ravel()


def by_folds(groups: np.ndarray, labels: np.ndarray, *, folds: int, fold: int, across: bool) -> np.ndarray:
    """int8 (T,), TRAIN or TEST: group number i of a class is on the test side when i modulo folds is `fold`.

    Args:
        groups: (T,) split groups.
        labels: (T,) classes; each class deals out its own groups.
        across: groups span classes (sessions), so they are dealt out once for all.
    """
    side = np.full(len(groups), TRAIN, dtype=np.int8)
    for label in [None] if across else np.unique(labels):
        mine = np.ones(len(groups), dtype=bool) if across else labels == label
        test = np.unique(groups[mine])[fold::folds]
        side[mine & np.isin(groups, test)] = TEST
    return side


def take_validation(
    side: np.ndarray, groups: np.ndarray, labels: np.ndarray, *, share: float, across: bool, rng: np.random.Generator
) -> np.ndarray:
    """A copy of `side` in which that share of each class's training groups is VALIDATION.

    At least one group a class where it has two or more, and never its last.
    """
    side = side.copy()
    if share == 0:
        return side
    for label in [None] if across else np.unique(labels):
        mine = side == TRAIN if across else (side == TRAIN) & (labels == label)
        own = np.unique(groups[mine])
        count = min(len(own) - 1, max(1, round(share * len(own))))
        if count > 0:
            side[mine & np.isin(groups, rng.permutation(own)[:count])] = VALIDATION
    return side


def balanced_anchors(
    labels: np.ndarray, side: np.ndarray, *, minimum: int, rng: np.random.Generator
) -> tuple[np.ndarray, list[str]]:
    """bool (T,): equally many anchor frames of every class on a side, drawn at random, and what did not fit.

    As many as the smallest class has, but at least `minimum`: a class with fewer keeps what it has, so that one
    poor class does not cut all the others to a handful.
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
        poorer = sum(size < count for size in sizes)
        if poorer:
            notes.append(
                f"{name}: {poorer} of {len(sizes)} classes have fewer than {count} anchors and keep all their frames, "
                f"{min(sizes)} in the poorest"
            )
    return anchor, notes
