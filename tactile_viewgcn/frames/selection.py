"""From raw recordings to frames to learn from: rest, filter, classes, sides, anchors, and an account of all."""

from dataclasses import dataclass, field

import numpy as np

from tactile_viewgcn.baseline import Rest, empty_hand_rest, no_rest, quiet_rest
from tactile_viewgcn.filtering import flagged, in_contact
from tactile_viewgcn.frames import Frames
from tactile_viewgcn.params import Preprocess, Split
from tactile_viewgcn.recordings import EMPTY_HAND, Recordings
from tactile_viewgcn.recordings import TEST as PUBLISHED_TEST
from tactile_viewgcn.split import (
    SIDES,
    TEST,
    TRAIN,
    VALIDATION,
    balanced_anchors,
    by_folds,
    split_groups,
    take_validation,
)


@dataclass
class Selection:
    """What becomes of every frame (T,) of the recordings, and why."""

    filtered: np.ndarray  # bool: passed the filter
    keep: np.ndarray  # bool: passed, and its class takes part
    side: np.ndarray  # TRAIN, VALIDATION or TEST
    group: np.ndarray
    anchor: np.ndarray
    notes: list[str] = field(default_factory=list)


def prepare(
    recordings: Recordings, how: Preprocess, split: Split, rng: np.random.Generator
) -> tuple[Frames, Selection]:
    """The kept frames, and the account of every frame.

    Raises:
        ValueError: no sensor that ever changes; rest, flags or groups that the data does not have; fewer than two
            classes left; a side empty.
    """
    if not recordings.live.any():
        raise ValueError(
            f"{recordings.path}: no sensor's count changes from one to another of the frames ({len(recordings)}); "
            "expected some that do: is the glove connected?"
        )
    rest = {
        "empty_hand": lambda: empty_hand_rest(recordings),
        "quiet": lambda: quiet_rest(recordings, how.quiet_share),
        "none": lambda: no_rest(recordings, how.zero),
    }[how.baseline]()
    selection = select(recordings, rest, how, split, rng)
    return _gather(recordings, rest, selection, how), selection


def select(recordings: Recordings, rest: Rest, how: Preprocess, split: Split, rng: np.random.Generator) -> Selection:
    """Filter, split and balance; raises as `prepare` does."""
    objects = recordings.columns["object"]
    if how.filter == "flags":
        filtered = flagged(recordings)
    else:
        filtered = in_contact(recordings, rest, sensors=how.contact_sensors, sigmas=how.contact_sigmas)
    keep = filtered.copy()
    notes = _emptied(recordings, filtered, how)
    if not how.empty_hand_class:
        keep &= objects != _index(recordings.objects, EMPTY_HAND)
    group = split_groups(recordings.columns, split.by)
    side = _sides(recordings, keep, group, split, rng, notes)
    _require_classes(recordings, keep)
    _require_sides(keep, side, split)
    _drop_classes(recordings, keep, side, notes)
    _require_classes(recordings, keep)
    _require_sides(keep, side, split)
    published = how.filter == "flags" and split.by == "source" and "balanced" in recordings.columns
    if published:
        anchor = keep & recordings.columns["balanced"]
        notes.append("anchors: the source's own balanced frames")
        for code in np.unique(side[keep]):
            if not (anchor & (side == code)).any():
                raise ValueError(
                    f"the {SIDES[code]} side of split.by source has no balanced frames (isBalanced) that pass the "
                    "filter; expected some: set preprocess.filter to contact or choose another split.by"
                )
    else:
        anchor = np.zeros(len(keep), dtype=bool)
        anchor[keep], unequal = balanced_anchors(objects[keep], side[keep], minimum=how.balance_minimum, rng=rng)
        notes += unequal
    return Selection(filtered, keep, side, group, anchor, notes)


def account(recordings: Recordings, selection: Selection) -> list[dict[str, object]]:
    """Per object and session: frames, what the filter and the split took, what is left, and the anchors."""
    objects, sessions, rows = recordings.columns["object"], recordings.columns["session"], []
    for label, name in enumerate(recordings.objects):
        for number, session in enumerate(recordings.sessions):
            mine = (objects == label) & (sessions == number)
            if not mine.any():
                continue
            kept = mine & selection.keep
            row = {
                "object": name,
                "session": session,
                "frames": int(mine.sum()),
                "dropped_by_filter": int((mine & ~selection.filtered).sum()),
                "dropped_with_class": int((mine & selection.filtered & ~selection.keep).sum()),
                "kept": int(kept.sum()),
            }
            for code, side in enumerate(SIDES):
                row[f"anchors_{side}"] = int((kept & selection.anchor & (selection.side == code)).sum())
            rows.append(row)
    return rows


def _emptied(recordings: Recordings, filtered: np.ndarray, how: Preprocess) -> list[str]:
    """Recordings and objects of which the filter leaves nothing."""
    notes, bar = (
        [],
        f"{how.contact_sensors} sensors above {how.contact_sigmas:g} sd" if how.filter == "contact" else "a flag",
    )
    for column, names in (("recording", recordings.recordings), ("object", recordings.objects)):
        had = np.bincount(recordings.columns[column], minlength=len(names)) > 0
        left = np.bincount(recordings.columns[column][filtered], minlength=len(names)) > 0
        gone = [names[i] for i in np.flatnonzero(had & ~left)]
        if gone:
            notes.append(f"filter: {len(gone)} of {had.sum()} {column}s dropped, no frame has {bar}: {', '.join(gone)}")
    return notes


def _sides(
    recordings: Recordings,
    keep: np.ndarray,
    group: np.ndarray,
    split: Split,
    rng: np.random.Generator,
    notes: list[str],
) -> np.ndarray:
    side = np.full(len(keep), TRAIN, dtype=np.int8)
    objects, across = recordings.columns["object"], split.by == "session"
    if split.by == "source":
        side[recordings.columns["split"] == PUBLISHED_TEST] = TEST
        owner = recordings.columns["recording"]
        shared = np.intersect1d(owner[keep & (side == TRAIN)], owner[keep & (side == TEST)])
        notes.append(f"split: the published split has {len(shared)} recordings on both sides")
    else:
        side[keep] = by_folds(group[keep], objects[keep], folds=split.folds, fold=split.fold, across=across)
    side[keep] = take_validation(side[keep], group[keep], objects[keep], share=split.validation, across=across, rng=rng)
    return side


def _drop_classes(recordings: Recordings, keep: np.ndarray, side: np.ndarray, notes: list[str]) -> None:
    """Take classes out of `keep` that cannot be learnt; the empty hand also where it cannot be tested."""
    objects = recordings.columns["object"]
    for label, name in enumerate(recordings.objects):
        mine = keep & (objects == label)
        trains, tests = (mine & (side == TRAIN)).any(), (mine & (side == TEST)).any()
        if not mine.any() or (trains and tests):
            continue
        if name == EMPTY_HAND:
            keep &= ~mine
            notes.append(f"classes: {name} cannot stand on both sides and leaves; it stays the baseline")
        elif not trains:
            keep &= ~mine
            notes.append(f"classes: {name} has no training frames and leaves")
        else:
            notes.append(f"classes: {name} has no test frames; it stays a class that can be mistaken for others")


def _require_sides(keep: np.ndarray, side: np.ndarray, split: Split) -> None:
    needed = {TRAIN, TEST} | ({VALIDATION} if split.validation else set())
    empty = [SIDES[code] for code in sorted(needed) if not (keep & (side == code)).any()]
    if empty:
        raise ValueError(
            f"the {' and the '.join(empty)} side of split.by {split.by} (fold {split.fold} of {split.folds}) has no "
            "frames; expected some on each: choose another split.by, folds or fold"
        )


def _require_classes(recordings: Recordings, keep: np.ndarray) -> None:
    left = np.unique(recordings.columns["object"][keep])
    if len(left) < 2:
        names = ", ".join(recordings.objects[i] for i in left) or "none"
        raise ValueError(f"fewer than two classes left ({names}); loosen preprocess.filter or change split.by")


def _gather(recordings: Recordings, rest: Rest, selection: Selection, how: Preprocess) -> Frames:
    index = np.flatnonzero(selection.keep)
    columns = {name: values[index] for name, values in recordings.columns.items()}
    objects, label = np.unique(columns["object"], return_inverse=True)
    return Frames(
        counts=recordings.frames(index),
        label=label.astype(np.int16),
        recording=columns["recording"],
        session=columns["session"],
        group=selection.group[index],
        side=selection.side[index],
        anchor=selection.anchor[index],
        rest=rest.of_frame[index],
        time=columns["time"],
        rest_mean=rest.mean,
        live=recordings.live,
        classes=[recordings.objects[i] for i in objects],
        recordings=recordings.recordings,
        sessions=recordings.sessions,
        rest_names=rest.names,
        kind=how.transform,
        scale=how.scale,
    )


def _index(names: list[str], name: str) -> int:
    return names.index(name) if name in names else -1
