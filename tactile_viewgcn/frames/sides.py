"""The side of every frame, dealt before any reading is looked at, and what each side must have."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.frames.split import fold_sides, spans_classes, split_groups, surplus_groups, validation_sides
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, several
from tactile_viewgcn.params import Split
from tactile_viewgcn.readers.source import TEST as PUBLISHED_TEST
from tactile_viewgcn.readers.source import TRAIN as PUBLISHED_TRAIN
from tactile_viewgcn.tables.frames import SIDES, TEST, TRAIN, VALIDATION
from tactile_viewgcn.tables.recordings import Recordings


@dataclass(frozen=True)
class Sides:
    """The side of every frame (T,).

    Attributes:
        group: int64, split group.
        side: int8, TRAIN, VALIDATION or TEST.
        surplus: bool, of training groups beyond `split.train_groups`, of a recording's grasps beyond
            `split.train_grasps`, or of the empty hand that is no class: not used.
    """

    group: np.ndarray
    side: np.ndarray
    surplus: np.ndarray

    @property
    def training(self) -> np.ndarray:
        """bool (T,): frames that are trained on."""
        return (self.side == TRAIN) & ~self.surplus

    def others(self) -> list[tuple[str, np.ndarray]]:
        """Name and frames bool (T,) of each part that is not trained on and has frames."""
        parts = ("validation", self.side == VALIDATION), ("test", self.side == TEST), ("left out", self.surplus)
        return [(name, frames) for name, frames in parts if frames.any()]


def one_class(name: str, where: str = "the recordings have") -> str:
    """The sentence on a single class: there is nothing to choose between."""
    return f"{where} one class, {name}; expected two or more"


def deal(
    recordings: Recordings,
    split: Split,
    rng: np.random.Generator,
    *,
    empty_hand_class: bool,
    groups: np.ndarray | None = None,
) -> Sides:
    """Deal the split groups to the sides; the empty hand's frames only if it is a class.

    Args:
        groups: (T,) split group of each frame, for a training without a test side; `split.validation` of the groups are
            on the validation side. None: `split.by` names the groups and the test side.

    Raises:
        UserError: there is one class; `split.by` is `grasp` or `source`, and the recordings have no such column; there
            are `split.train_grasps`, and grasps are not numbered; a side that is needed has no frames.
    """
    columns = recordings.columns
    surplus = recordings.empty_hand & (not empty_hand_class)
    used = np.flatnonzero(~surplus)
    recorded = np.unique(columns["object"][used])
    if len(recorded) == 1:
        raise UserError(one_class(recordings.objects[recorded[0]]))
    by, group = ("", groups) if groups is not None else (split.by, split_groups(columns, split.by))
    side = np.full(len(group), TRAIN, dtype=np.int8)
    label, of_used = columns["object"][used], group[used]
    across = by == "session" if by else spans_classes(of_used, label)
    if by == "source":
        side[columns["split"] == PUBLISHED_TEST] = TEST
    elif by:
        side[used] = fold_sides(of_used, label, folds=split.folds, fold=split.fold, across=across, deal=split.deal)
    side[used] = validation_sides(side[used], of_used, label, share=split.validation, across=across, rng=rng)
    if split.train_groups != "all":
        surplus[used] = surplus_groups(side[used], of_used, label, most=split.train_groups)
    if split.train_grasps != "all":
        grasps = split_groups(columns, "grasp")
        surplus |= surplus_groups(side, grasps, split_groups(columns, "recording"), most=split.train_grasps)
    if by:
        _require_frames(side, ~surplus, split)
    return Sides(group, side, surplus)


def keep_testable(
    recordings: Recordings, sides: Sides, keep: np.ndarray, split: Split
) -> tuple[np.ndarray, list[Note]]:
    """The frames of `keep` bool (T,) whose class has training frames, and notes on dropped classes and on the split.

    The empty hand without test frames is dropped, too; any other class without them is kept.

    Raises:
        UserError: a side that is needed has no frames.
    """
    objects, recording = recordings.columns["object"], recordings.columns["recording"]
    left, tested, notes = keep.copy(), sides.side == TEST, list[Note]()
    if split.by == "source":
        shared = np.intersect1d(recording[keep & (sides.side == TRAIN)], recording[keep & tested])
        text = f"the published split has {several(len(shared), 'recording')} on both sides"
        notes.append(Note(text, topic="split"))
    for label, name in enumerate(recordings.objects):
        of_class = keep & (objects == label)
        trains, tests = (of_class & sides.training).any(), (of_class & tested).any()
        if not of_class.any() or (trains and tests):
            continue
        if name == EMPTY_HAND or not trains:
            left &= ~of_class
        if name == EMPTY_HAND:
            text = "is not on both sides and is dropped; it still gives the baseline"
        elif trains:
            text = "has no test frames; it is kept as a class that others can be mistaken for"
        else:
            text = "has no training frames and is dropped"
        notes.append(Note(f"{name} {text}", topic="objects"))
    for frames in (keep, left):  # before classes are dropped, so that the message names the side that was empty then
        _require_frames(sides.side, frames & ~sides.surplus, split)
    return left, notes


def has_published_split(recordings: Recordings) -> bool:
    """Whether the source names a training and a test side, and every object is on both."""
    columns, of_object = recordings.columns, ~recordings.empty_hand
    if "split" not in columns:
        return False
    objects, split = columns["object"][of_object], columns["split"][of_object]
    return bool(
        np.array_equal(np.unique(objects[split == PUBLISHED_TRAIN]), np.unique(objects[split == PUBLISHED_TEST]))
    )


def _require_frames(side: np.ndarray, frames: np.ndarray, split: Split) -> None:
    """Raise a UserError if a side that is needed has none of the frames bool (T,)."""
    needed = {TRAIN, TEST} | ({VALIDATION} if split.validation else set())
    if empty := [SIDES[code] for code in sorted(needed) if not (frames & (side == code)).any()]:
        raise UserError(
            f"the {' and the '.join(empty)} side of split.by {split.by} (fold {split.fold} of {split.folds}) has "
            "no frames; expected some on each, so two groups of an object or more: record more, or choose another "
            "split.by, folds or fold"
        )
