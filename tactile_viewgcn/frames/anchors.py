"""The frames that view sets are drawn around: equally many of every class."""

import numpy as np

from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.tables.frames import SIDES

MINIMUM = 100  # anchors that a class keeps at least; a class with fewer frames uses all of them


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
