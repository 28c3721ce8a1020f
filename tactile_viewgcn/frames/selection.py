"""Which frames are kept, on which side each is, and which are anchors; with notes on everything that was left out."""

from dataclasses import dataclass, field

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import Baseline
from tactile_viewgcn.frames.filtering import flagged, in_contact
from tactile_viewgcn.frames.split import (
    SIDES,
    TEST,
    TRAIN,
    VALIDATION,
    balanced_anchors,
    fold_sides,
    frame_sides,
    spans_classes,
    split_groups,
    surplus_groups,
    validation_sides,
)
from tactile_viewgcn.params import Preprocess, Split
from tactile_viewgcn.readers.source import EMPTY_HAND, listed
from tactile_viewgcn.readers.source import TEST as PUBLISHED_TEST
from tactile_viewgcn.tables.recordings import Recordings

LOOSEN = "lower preprocess.contact_sensors or contact_sigmas, or choose another preprocess.filter"


@dataclass
class Selection:
    """What becomes of every frame (T,) of the recordings.

    Attributes:
        filtered: bool, passed the filter.
        keep: bool, passed the filter, and its class and place in its group are used.
        side: TRAIN, VALIDATION or TEST.
        group: split group.
        anchor: bool, a view set is drawn around it.
        notes: sentences on what was left out and why.
    """

    filtered: np.ndarray
    keep: np.ndarray
    side: np.ndarray
    group: np.ndarray
    anchor: np.ndarray
    notes: list[str] = field(default_factory=list)


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
    objects, contact = recordings.columns["object"], preprocess.filter == "contact"
    if contact:
        sensors, sigmas = preprocess.contact_sensors, preprocess.contact_sigmas
        filtered = in_contact(recordings, baseline, sensors=sensors, sigmas=sigmas)
        notes = _dropped_by_filter(recordings, filtered, "contact", f"{sensors} sensors above {sigmas:g} sd")
    elif preprocess.filter == "none":
        filtered, notes = np.ones(len(objects), dtype=bool), []
    else:
        filtered = flagged(recordings)
        notes = _dropped_by_filter(recordings, filtered, "flags", "a flag")
    keep = filtered.copy()
    if not preprocess.empty_hand_class and EMPTY_HAND in recordings.objects:
        keep &= objects != recordings.objects.index(EMPTY_HAND)
    if groups is not None:
        group, across = groups, spans_classes(groups, objects)
        side = np.full(len(keep), TRAIN, dtype=np.int8)
        side[keep] = validation_sides(
            side[keep], group[keep], objects[keep], share=split.validation, across=across, rng=rng
        )
        _require_classes(recordings, keep)
    else:
        group = split_groups(recordings.columns, split.by)
        side = _sides(recordings, keep, group, split, rng, notes)
        _require_classes(recordings, keep)
        _require_sides(keep, side, split)
        _drop_classes(recordings, keep, side, notes)
        _require_classes(recordings, keep)
        _require_sides(keep, side, split)
    if groups is None and preprocess.filter == "flags" and split.by == "source" and "balanced" in recordings.columns:
        anchor = keep & recordings.columns["balanced"]
        notes.append("anchors: the source's balanced frames")
        _require_anchors(keep, side, anchor)
    else:
        anchor = np.zeros(len(keep), dtype=bool)
        minimum = preprocess.balance_minimum
        anchor[keep], unequal = balanced_anchors(objects[keep], side[keep], minimum=minimum, rng=rng)
        notes += unequal
    if split.train_groups != "all":
        unused = surplus_groups(side[keep], group[keep], objects[keep], most=split.train_groups)
        keep[np.flatnonzero(keep)[unused]] = (
            False  # after the anchors are drawn: those of the other sides stay the same
        )
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


def _dropped_by_filter(recordings: Recordings, filtered: np.ndarray, name: str, condition: str) -> list[str]:
    """Notes on frames without the filter's condition, and on recordings and objects without a frame with it."""
    dropped = len(filtered) - int(filtered.sum())
    notes = [f"filter {name}: {dropped:,} of {len(filtered):,} frames dropped, without {condition}"]
    for column, names in (("recording", recordings.recordings), ("object", recordings.objects)):
        before = np.bincount(recordings.columns[column], minlength=len(names)) > 0
        after = np.bincount(recordings.columns[column][filtered], minlength=len(names)) > 0
        emptied = [names[i] for i in np.flatnonzero(before & ~after)]
        if not emptied:
            continue
        told = (
            f"filter: {len(emptied)} of {before.sum()} {column}s dropped, no frame has {condition}: {listed(emptied)}"
        )
        notes.append(told if column == "recording" else f"warning: {told}; {LOOSEN}")
    return notes


def _sides(
    recordings: Recordings,
    keep: np.ndarray,
    group: np.ndarray,
    split: Split,
    rng: np.random.Generator,
    notes: list[str],
) -> np.ndarray:
    """Side int8 (T,) of each frame by `split.by`; what a user should know of the split is appended to `notes`."""
    side = np.full(len(keep), TRAIN, dtype=np.int8)
    objects, across = recordings.columns["object"], split.by == "session"
    if split.by == "source":
        side[recordings.columns["split"] == PUBLISHED_TEST] = TEST
        recording = recordings.columns["recording"]
        shared = np.intersect1d(recording[keep & (side == TRAIN)], recording[keep & (side == TEST)])
        notes.append(f"split: the published split has {len(shared)} recordings on both sides")
    elif split.by == "frame":
        side[keep] = frame_sides(objects[keep], folds=split.folds, fold=split.fold, rng=rng)
        notes.append("split: by single frames, whose neighbours in time are on the other side: it leaks")
    else:
        side[keep] = fold_sides(
            group[keep], objects[keep], folds=split.folds, fold=split.fold, across=across, deal=split.deal
        )
    side[keep] = validation_sides(
        side[keep], group[keep], objects[keep], share=split.validation, across=across, rng=rng
    )
    return side


def _drop_classes(recordings: Recordings, keep: np.ndarray, side: np.ndarray, notes: list[str]) -> None:
    """Remove classes without training frames from `keep`, and the empty hand where it has no test frames."""
    objects = recordings.columns["object"]
    for label, name in enumerate(recordings.objects):
        of_class = keep & (objects == label)
        trains, tests = (of_class & (side == TRAIN)).any(), (of_class & (side == TEST)).any()
        if not of_class.any() or (trains and tests):
            continue
        if name == EMPTY_HAND:
            keep &= ~of_class
            notes.append(f"classes: {name} is not on both sides and is dropped; it still gives the baseline")
        elif not trains:
            keep &= ~of_class
            notes.append(f"classes: {name} has no training frames and is dropped")
        else:
            notes.append(f"classes: {name} has no test frames; it is kept as a class that others can be mistaken for")


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
