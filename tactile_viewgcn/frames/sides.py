"""The side of every frame, dealt before any reading is looked at, so that choices keep to the training side."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.frames.baseline import has_empty_hand, of_empty_hand
from tactile_viewgcn.frames.split import (
    fold_sides,
    frame_sides,
    spans_classes,
    split_groups,
    surplus_groups,
    validation_sides,
)
from tactile_viewgcn.params import Split
from tactile_viewgcn.readers.source import TEST as PUBLISHED_TEST
from tactile_viewgcn.readers.source import TRAIN as PUBLISHED_TRAIN
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tactile_viewgcn.tables.recordings import Recordings


@dataclass(frozen=True)
class Sides:
    """The side of every frame (T,), dealt before any reading is looked at.

    Attributes:
        group: int64, split group.
        side: int8, TRAIN, VALIDATION or TEST.
        surplus: bool, of training groups beyond `split.train_groups`: not trained on.
        whole: whole groups can be held out; False where single frames are.
    """

    group: np.ndarray
    side: np.ndarray
    surplus: np.ndarray
    whole: bool

    @property
    def training(self) -> np.ndarray:
        """bool (T,): frames that a choice may look at."""
        return (self.side == TRAIN) & ~self.surplus


def deal(
    recordings: Recordings,
    split: Split,
    rng: np.random.Generator,
    *,
    empty_hand_class: bool,
    groups: np.ndarray | None = None,
) -> Sides:
    """Deal the split groups to the sides; the empty hand's frames only where it is a class.

    Args:
        groups: (T,) split group of each frame, where none is for the test: all are on the training side, but for
            `split.validation` of the groups. None: `split.by` names the groups and the test side.

    Raises:
        UserError: `split.by` is `grasp` or `source`, and the recordings have no such column.
    """
    columns = recordings.columns
    used = np.flatnonzero(empty_hand_class | ~of_empty_hand(recordings))
    by, group = ("", groups) if groups is not None else (split.by, split_groups(columns, split.by))
    side, surplus = np.full(len(group), TRAIN, dtype=np.int8), np.zeros(len(group), dtype=bool)
    label, of_used = columns["object"][used], group[used]
    across = by == "session" if by else spans_classes(of_used, label)
    if by == "source":
        side[columns["split"] == PUBLISHED_TEST] = TEST
    elif by == "frame":
        side[used] = frame_sides(label, folds=split.folds, fold=split.fold, rng=rng)
    elif by:
        side[used] = fold_sides(of_used, label, folds=split.folds, fold=split.fold, across=across, deal=split.deal)
    side[used] = validation_sides(side[used], of_used, label, share=split.validation, across=across, rng=rng)
    if split.train_groups != "all":
        surplus[used] = surplus_groups(side[used], of_used, label, most=split.train_groups)
    return Sides(group, side, surplus, whole=by != "frame")


def has_published_split(recordings: Recordings) -> bool:
    """Whether the source names a training and a test side, and every object is on both."""
    columns, of_object = recordings.columns, ~of_empty_hand(recordings)
    if "split" not in columns:
        return False
    objects, split = columns["object"][of_object], columns["split"][of_object]
    return bool(
        np.array_equal(np.unique(objects[split == PUBLISHED_TRAIN]), np.unique(objects[split == PUBLISHED_TEST]))
    )


def follows_paper(recordings: Recordings) -> bool:
    """Whether there are an empty hand in every session, and a published split with every object on both sides."""
    return has_empty_hand(recordings) and has_published_split(recordings)
