"""Which frames are kept, on which side each is, and which are anchors; with notes on everything that was left out."""

from dataclasses import dataclass, field

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import Baseline, of_empty_hand
from tactile_viewgcn.frames.filtering import passing
from tactile_viewgcn.frames.split import (
    balanced_anchors,
    frame_sides,
    sides_of_split,
    spans_classes,
    split_groups,
    surplus_groups,
    validation_sides,
)
from tactile_viewgcn.names import EMPTY_HAND
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.params import Preprocess, Split
from tactile_viewgcn.readers.source import TEST as PUBLISHED_TEST
from tactile_viewgcn.tables.frames import SIDES, TEST, TRAIN, VALIDATION
from tactile_viewgcn.tables.recordings import Recordings


@dataclass
class Selection:
    """What becomes of every frame (T,) of the recordings.

    Attributes:
        filtered: bool, passed the filter.
        keep: bool, passed the filter, and its class and place in its group are used.
        side: TRAIN, VALIDATION or TEST.
        group: split group.
        anchor: bool, a view set is drawn around it.
        notes: on what was left out and why.
    """

    filtered: np.ndarray
    keep: np.ndarray
    side: np.ndarray
    group: np.ndarray
    anchor: np.ndarray
    notes: list[Note] = field(default_factory=list)


def select(
    recordings: Recordings,
    baseline: Baseline,
    preprocess: Preprocess,
    split: Split,
    rng: np.random.Generator,
    groups: np.ndarray | None = None,
) -> Selection:
    """Filter, split and balance the frames.

    Args:
        groups: (T,) split group of each frame, where none is for the test: all are on the training side, but for
            `split.validation` of the groups. None: `split.by` names the groups and the test side.

    Raises:
        UserError: flags or groups that the recordings do not have, fewer than two classes left, or an empty side.
    """
    objects = recordings.columns["object"]
    recorded = np.unique(objects if preprocess.empty_hand_class else objects[~of_empty_hand(recordings)])
    if len(recorded) == 1:
        raise UserError(one_class(recordings.objects[recorded[0]]))
    filtered, notes = passing(recordings, baseline, preprocess)
    keep = filtered.copy()
    if not preprocess.empty_hand_class:
        keep &= ~of_empty_hand(recordings)
    if groups is not None:
        group, across = groups, spans_classes(groups, objects)
        side = np.full(len(keep), TRAIN, dtype=np.int8)
    else:
        group, across = split_groups(recordings.columns, split.by), split.by == "session"
        side = _test_side(recordings, keep, group, split, rng, notes)
    side[keep] = validation_sides(
        side[keep], group[keep], objects[keep], share=split.validation, across=across, rng=rng
    )
    _require_classes(recordings, keep)
    if groups is None:
        _require_sides(keep, side, split)
        _drop_classes(recordings, keep, side, notes)
        _require_classes(recordings, keep)
        _require_sides(keep, side, split)
    if groups is None and preprocess.filter == "flags" and split.by == "source" and "balanced" in recordings.columns:
        anchor = keep & recordings.columns["balanced"]
        notes.append(Note("the source's balanced frames", topic="anchors"))
        _require_anchors(keep, side, anchor)
    else:
        anchor = np.zeros(len(keep), dtype=bool)
        minimum = preprocess.balance_minimum
        anchor[keep], unequal = balanced_anchors(objects[keep], side[keep], minimum=minimum, rng=rng)
        notes += unequal
    if split.train_groups != "all":
        unused = surplus_groups(side[keep], group[keep], objects[keep], most=split.train_groups)
        keep[np.flatnonzero(keep)[unused]] = False  # after the draw of anchors: those of the other sides stay the same
    return Selection(filtered, keep, side, group, anchor & keep, notes)


def frame_counts(side: np.ndarray, anchor: np.ndarray, *, group: np.ndarray, recording: np.ndarray) -> dict[str, int]:
    """Numbers of frames, anchors, groups and recordings on each side, of kept frames (n,)."""
    counts: dict[str, int] = {}
    for code, name in enumerate(SIDES):
        on = side == code
        counts |= {
            f"frames.{name}": int(on.sum()),
            f"anchors.{name}": int((on & anchor).sum()),
            f"groups.{name}": len(np.unique(group[on])),
            f"recordings.{name}": len(np.unique(recording[on])),
        }
    return counts


def selection_counts(recordings: Recordings, selection: Selection) -> list[dict[str, object]]:
    """Rows of a table, one per object and session: frames, how many were dropped and why, kept, and anchors."""
    objects, sessions, rows = recordings.columns["object"], recordings.columns["session"], []
    for label, name in enumerate(recordings.objects):
        for number, session in enumerate(recordings.sessions):
            cell = (objects == label) & (sessions == number)
            if not cell.any():
                continue
            kept = cell & selection.keep
            row: dict[str, object] = {
                "object": name,
                "session": session,
                "frames": int(cell.sum()),
                "dropped_by_filter": int((cell & ~selection.filtered).sum()),
                "dropped_with_class": int((cell & selection.filtered & ~selection.keep).sum()),
                "kept": int(kept.sum()),
            }
            for code, side in enumerate(SIDES):
                row[f"anchors_{side}"] = int((kept & selection.anchor & (selection.side == code)).sum())
            rows.append(row)
    return rows


def _test_side(
    recordings: Recordings,
    keep: np.ndarray,
    group: np.ndarray,
    split: Split,
    rng: np.random.Generator,
    notes: list[Note],
) -> np.ndarray:
    """TRAIN or TEST int8 (T,) by `split.by`; what a user should know of the split is appended to `notes`."""
    side = np.full(len(keep), TRAIN, dtype=np.int8)
    objects = recordings.columns["object"]
    if split.by == "source":
        side[recordings.columns["split"] == PUBLISHED_TEST] = TEST
        recording = recordings.columns["recording"]
        shared = np.intersect1d(recording[keep & (side == TRAIN)], recording[keep & (side == TEST)])
        notes.append(Note(f"the published split has {several(len(shared), 'recording')} on both sides", topic="split"))
    elif split.by == "frame":
        side[keep] = frame_sides(objects[keep], folds=split.folds, fold=split.fold, rng=rng)
        notes.append(Note("by single frames, whose neighbours in time are on the other side: it leaks", topic="split"))
    else:
        side[keep] = sides_of_split(split, group[keep], objects[keep])
    return side


def _drop_classes(recordings: Recordings, keep: np.ndarray, side: np.ndarray, notes: list[Note]) -> None:
    """Remove classes without training frames from `keep`, and the empty hand where it has no test frames."""
    objects = recordings.columns["object"]
    for label, name in enumerate(recordings.objects):
        of_class = keep & (objects == label)
        trains, tests = (of_class & (side == TRAIN)).any(), (of_class & (side == TEST)).any()
        if not of_class.any() or (trains and tests):
            continue
        if name == EMPTY_HAND:
            keep &= ~of_class
            text = "is not on both sides and is dropped; it still gives the baseline"
        elif not trains:
            keep &= ~of_class
            text = "has no training frames and is dropped"
        else:
            text = "has no test frames; it is kept as a class that others can be mistaken for"
        notes.append(Note(f"{name} {text}", topic="objects"))


def _require_sides(keep: np.ndarray, side: np.ndarray, split: Split) -> None:
    """Raise a UserError if a side that is needed has no frames."""
    needed = {TRAIN, TEST} | ({VALIDATION} if split.validation else set())
    empty = [SIDES[code] for code in sorted(needed) if not (keep & (side == code)).any()]
    if empty:
        raise UserError(
            f"the {' and the '.join(empty)} side of split.by {split.by} (fold {split.fold} of {split.folds}) has no "
            "frames; expected some on each, so two groups of an object or more: record more, or choose another "
            "split.by, folds or fold"
        )


def one_class(name: str, where: str = "the recordings have") -> str:
    """The sentence on a single class, which nothing can be told from."""
    return f"{where} one class, {name}; expected two or more"


def _require_classes(recordings: Recordings, keep: np.ndarray) -> None:
    """Raise a UserError if fewer than two classes are left."""
    left = np.unique(recordings.columns["object"][keep])
    if len(left) < 2:
        names = ", ".join(recordings.objects[i] for i in left) or "none"
        raise UserError(f"fewer than two classes left ({names}); loosen preprocess.filter or change split.by")


def _require_anchors(keep: np.ndarray, side: np.ndarray, anchor: np.ndarray) -> None:
    """Raise a UserError if a side with frames has no anchors among the source's balanced frames."""
    for code in np.unique(side[keep]):
        if not (anchor & (side == code)).any():
            raise UserError(
                f"the {SIDES[code]} side of split.by source has no balanced frames (isBalanced) that pass the "
                "filter; expected some: set preprocess.filter to contact or choose another split.by"
            )
