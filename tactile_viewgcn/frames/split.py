"""The sides of the split and the anchors on them.

Frames of one recording resemble each other far more than frames of two, so all frames of a split
group (a recording, a grasp, a session) are on one side. The published split is the exception: its
sides are used as they are, and the number of recordings on both of them is reported. No reading is
looked at.
"""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.frames.folds import each_class, in_fold, spans_classes
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, several
from tactile_viewgcn.params import SIDES, TEST, TRAIN, VALIDATION, Split
from tactile_viewgcn.tables.recordings import Recordings

MINIMUM = 100  # anchors that a class keeps at least; a class with fewer frames uses all of them
# of anchors and validation groups, so that these are the same for every value of `seed`
SPLIT_SEED = 0


@dataclass(frozen=True)
class Sides:
    """The side of every frame (T,).

    Attributes:
        group: int64, split group.
        side: int8, TRAIN, VALIDATION or TEST.
        surplus: bool, of training groups beyond `split.train_groups`, of a recording's grasps
            beyond `split.train_grasps`, or of the empty hand that is no class: not used.
    """

    group: np.ndarray
    side: np.ndarray
    surplus: np.ndarray

    @property
    def training(self) -> np.ndarray:
        """bool (T,): frames that are trained on."""
        return (self.side == TRAIN) & ~self.surplus


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
        groups: (T,) split group of each frame, for a training without a test side;
            `split.validation` of the groups are on the validation side. None: `split.by` names the
            groups and the test side.

    Raises:
        UserError: there is one class; `split.by` is `grasp` or `source`, and the recordings have no
            such column; there are `split.train_grasps`, and grasps are not numbered; a side that is
            needed has no frames.
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
        side[published_test(columns["split"])] = TEST
    elif by:
        tested = in_fold(
            of_used, label, folds=split.folds, fold=split.fold, across=across, deal=split.deal
        )
        side[used[tested]] = TEST
    side[used] = validation_sides(
        side[used], of_used, label, share=split.validation, across=across, rng=rng
    )
    if split.train_groups != "all":
        surplus[used] = surplus_groups(side[used], of_used, label, most=split.train_groups)
    if split.train_grasps != "all":
        grasps = split_groups(columns, "grasp")
        surplus |= surplus_groups(
            side, grasps, split_groups(columns, "recording"), most=split.train_grasps
        )
    if by:
        _require_frames(side, ~surplus, split)
    return Sides(group, side, surplus)


def one_class(name: str, where: str = "the recordings have") -> str:
    """The sentence on a single class: there is nothing to choose between."""
    return f"{where} one class, {name}; expected two or more"


def split_groups(columns: dict[str, np.ndarray], by: str) -> np.ndarray:
    """Split group int64 (T,) of each frame from its columns (T,), numbered in the order of the recordings.

    A recording of several objects is a group per object; recordings that belong together are one
    group. With `source` the recordings are the groups.

    Raises:
        UserError: `grasp` or `source`, and the recordings have no such column.
    """
    column = {"grasp": "grasp", "source": "split"}.get(by)
    if column and column not in columns:
        remedy = "set split.by to recording or session, and split.train_grasps to all"
        raise UserError(f"the recordings have no column {column!r}: {remedy}")
    if by == "session":
        return columns["session"].astype(np.int64)
    keys = [columns.get("take", columns["recording"]), columns["object"]]
    keys += [columns["grasp"]] if by == "grasp" else []
    return np.unique(np.stack(keys, axis=1), axis=0, return_inverse=True)[1].ravel()


def validation_sides(
    side: np.ndarray,
    groups: np.ndarray,
    labels: np.ndarray,
    *,
    share: float,
    across: bool,
    rng: np.random.Generator,
) -> np.ndarray:
    """Copy of `side` (T,) with a share of each class's training groups, drawn at random, as VALIDATION.

    A class with two groups or more gives at least one and keeps at least one.
    """
    side = side.copy()
    for _, of_class in each_class(labels, across) if share else []:
        trained = of_class & (side == TRAIN)
        candidates = np.unique(groups[trained])
        count = min(len(candidates) - 1, max(1, round(share * len(candidates))))
        if count > 0:
            side[trained & np.isin(groups, rng.permutation(candidates)[:count])] = VALIDATION
    return side


def surplus_groups(
    side: np.ndarray, groups: np.ndarray, labels: np.ndarray, *, most: int
) -> np.ndarray:
    """bool (T,): training frames of a class, or of a recording in its place, outside its first `most` groups."""
    surplus = np.zeros(len(side), dtype=bool)
    for _, of_class in each_class(labels):
        trained = of_class & (side == TRAIN)
        surplus |= trained & ~np.isin(groups, np.unique(groups[trained])[:most])
    return surplus


def keep_testable(
    recordings: Recordings, sides: Sides, keep: np.ndarray, split: Split
) -> tuple[np.ndarray, list[Note]]:
    """The frames of `keep` bool (T,) whose class has training frames, and notes on dropped classes and on the split.

    The empty hand without test frames is dropped, too; any other class without them is kept.
    Without a test side all frames are kept.

    Raises:
        UserError: a side that is needed has no frames; fewer than two classes are left.
    """
    objects, recording = recordings.columns["object"], recordings.columns["recording"]
    left, tested, notes = keep.copy(), sides.side == TEST, list[Note]()
    if tested.any():
        if split.by == "source":
            shared = np.intersect1d(
                recording[keep & (sides.side == TRAIN)], recording[keep & tested]
            )
            text = f"the published split has {several(len(shared), 'recording')} on both sides"
            if (~tested & (recordings.columns["split"] == VALIDATION)).any():
                text += "; its validation groups are on the training side, of which split.validation sets a share apart"
            notes.append(Note(text, topic="split"))
        for label in np.unique(objects[keep]):
            name, of_class = recordings.objects[label], keep & (objects == label)
            trains, tests = (of_class & sides.training).any(), (of_class & tested).any()
            if trains and tests:
                continue
            dropped = name == EMPTY_HAND or not trains
            left &= ~(of_class & dropped)
            text = f"{name} has no {'test' if trains else 'training'} frames and is "
            text += "dropped" if dropped else "kept as a class that others can be mistaken for"
            notes.append(Note(text, topic="objects"))
        _require_frames(sides.side, left & ~sides.surplus, split)
    classes = np.unique(objects[left])
    if len(classes) < 2:
        names = ", ".join(recordings.objects[i] for i in classes) or "none"
        raise UserError(
            f"fewer than two classes left ({names}); loosen preprocess.filter or change split.by"
        )
    return left, notes


def has_published_split(recordings: Recordings) -> bool:
    """Whether the source names a training and a test side, and every object is on both."""
    columns, of_object = recordings.columns, ~recordings.empty_hand
    if "split" not in columns:
        return False
    objects, tests = columns["object"][of_object], published_test(columns["split"])[of_object]
    return np.array_equal(np.unique(objects[tests]), np.unique(objects[~tests]))


def published_test(split: np.ndarray) -> np.ndarray:
    """bool (T,): tested frames by their published side (T,): those of `test`, or without any those of `validation`."""
    return split == (TEST if (split == TEST).any() else VALIDATION)


def draw_anchors(
    columns: dict[str, np.ndarray],
    side: np.ndarray,
    keep: np.ndarray,
    rng: np.random.Generator,
    *,
    published: bool,
) -> np.ndarray:
    """Anchors bool (T,) among the frames to `keep` bool (T,).

    They are drawn at random, equally many of every class on a side: as many as the smallest class
    has frames, but at least 100, so that one small class does not reduce all others to a handful. A
    class with fewer frames uses all.

    Args:
        published: take the source's balanced frames instead, if it names them.
    """
    if published and "balanced" in columns:
        return keep & columns["balanced"]
    anchor = np.zeros(len(keep), dtype=bool)
    for code in range(len(SIDES)):
        on_side = keep & (side == code)
        of_class = [
            np.flatnonzero(on_side & (columns["object"] == label))
            for label in np.unique(columns["object"])
        ]
        count = max(MINIMUM, min(filter(None, map(len, of_class)), default=0))
        for index in of_class:
            anchor[rng.permutation(index)[:count]] = True
    return anchor


def _require_frames(side: np.ndarray, frames: np.ndarray, split: Split) -> None:
    """Raise a UserError if a side that is needed has none of the frames bool (T,)."""
    needed = {TRAIN, TEST} | ({VALIDATION} if split.validation else set())
    if empty := [SIDES[code] for code in sorted(needed) if not (frames & (side == code)).any()]:
        raise UserError(
            f"the {' and the '.join(empty)} side of split.by {split.by} (fold {split.fold} of {split.folds}) has "
            "no frames; expected some on each, so two groups of an object or more: record more, or choose another "
            "split.by, folds or fold"
        )
