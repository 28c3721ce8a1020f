"""From the table of raw counts to the frames that are learned from: split, choice, filter, classes and anchors."""

from dataclasses import asdict, dataclass

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.anchors import balanced_anchors, published_anchors
from tactile_viewgcn.frames.baseline import of_empty_hand
from tactile_viewgcn.frames.choose import Choice, choose
from tactile_viewgcn.frames.filtering import passing
from tactile_viewgcn.frames.scale_check import clipping_warnings
from tactile_viewgcn.frames.sides import Sides, deal
from tactile_viewgcn.frames.split import SPLIT_SEED
from tactile_viewgcn.names import EMPTY_HAND
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.params import PreprocessSection, Split
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import SIDES, TEST, TRAIN, VALIDATION, Frames
from tactile_viewgcn.tables.recordings import Recordings


@dataclass(frozen=True)
class Preprocessed:
    """The table of frames, and how it came about.

    Attributes:
        passed: bool (T,), frames that passed the filter.
        keep: bool (T,), frames of the table, in order: passed, of a class and a training group that are used.
        notes: on what `auto` chose, on the baseline and on what was left out, and warnings.
    """

    frames: Frames
    choice: Choice
    sides: Sides
    passed: np.ndarray
    keep: np.ndarray
    notes: list[Note]


def preprocess_recordings(
    recordings: Recordings, asked: PreprocessSection, split: Split, *, groups: np.ndarray | None = None
) -> Preprocessed:
    """Deal the sides, choose what is `auto`, filter the frames, and draw the anchors.

    Args:
        groups: see `deal`.

    Raises:
        UserError: no sensor that varies; a baseline, flags or groups that the recordings cannot give; fewer than two
            classes left; an empty side.
    """
    rng, objects, empty = stream(SPLIT_SEED, "preprocess"), recordings.columns["object"], of_empty_hand(recordings)
    recorded = np.unique(objects if asked.empty_hand_class else objects[~empty])
    if len(recorded) == 1:
        raise UserError(one_class(recordings.objects[recorded[0]]))
    sides = deal(recordings, split, rng, empty_hand_class=asked.empty_hand_class, groups=groups)
    choice = choose(recordings, asked, sides)
    passed, notes = passing(recordings, choice.baseline, choice.params)
    keep, published = passed.copy(), groups is None and split.by == "source"
    if not asked.empty_hand_class:
        keep &= ~empty
    notes += _split_notes(recordings, keep, sides.side, split) if groups is None else []
    _require_classes(recordings, keep)
    if groups is None:
        _require_sides(keep, sides, split)
        notes += _drop_classes(recordings, keep, sides)
        _require_classes(recordings, keep)
        _require_sides(keep, sides, split)
    if published and choice.params.filter == "flags" and "balanced" in recordings.columns:
        anchors = published_anchors(recordings.columns["balanced"][keep], sides.side[keep])
        notes.append(Note("the source's balanced frames", topic="anchors"))
    else:
        anchors, unequal = balanced_anchors(objects[keep], sides.side[keep], rng=rng)
        notes += unequal
    anchors = anchors[~sides.surplus[keep]]  # after the draw: those of the other sides stay the same
    keep &= ~sides.surplus
    frames = _table(recordings, choice, sides, keep, anchors, float(passed.mean()))
    notes = [*choice.notes, *choice.baseline.notes, *notes]
    if choice.hand:
        notes += clipping_warnings(frames, choice.hand.noise, chosen=asked.scale == "auto")
    return Preprocessed(frames, choice, sides, passed, keep, notes)


def _table(
    recordings: Recordings, choice: Choice, sides: Sides, keep: np.ndarray, anchors: np.ndarray, share: float
) -> Frames:
    """The kept frames (T,), whose classes are numbered by their order in the recordings; `share` passed the filter."""
    index, baseline, unknown = np.flatnonzero(keep), choice.baseline, np.full(recordings.shape, np.nan)
    columns = {name: values[index] for name, values in recordings.columns.items()}
    objects, label = np.unique(columns["object"], return_inverse=True)
    return Frames(
        counts=recordings.kept_counts(index),
        label=label.astype(np.int16),
        recording=columns["recording"],
        session=columns["session"],
        grasp=columns.get("grasp", np.zeros_like(columns["recording"])),
        group=sides.group[index],
        side=sides.side[index],
        anchor=anchors,
        baseline=baseline.of_frame[index],
        time=columns["time"],
        baseline_mean=baseline.mean,
        live=recordings.live,
        classes=[recordings.objects[i] for i in objects],
        recordings=recordings.recordings,
        sessions=recordings.sessions,
        baseline_names=baseline.names,
        transform=choice.params.transform,
        scale=float(choice.params.scale),
        noise=unknown if baseline.noise is None else baseline.noise[np.unique(baseline.of_frame)].mean(axis=0),
        preprocess=asdict(choice.params),
        kept_share=share,
    )


def _split_notes(recordings: Recordings, keep: np.ndarray, side: np.ndarray, split: Split) -> list[Note]:
    """What a user should know of a split that does not hold out whole groups."""
    if split.by == "frame":
        return [Note("by single frames, whose neighbours in time are on the other side: it leaks", topic="split")]
    if split.by != "source":
        return []
    recording = recordings.columns["recording"]
    shared = np.intersect1d(recording[keep & (side == TRAIN)], recording[keep & (side == TEST)])
    return [Note(f"the published split has {several(len(shared), 'recording')} on both sides", topic="split")]


def _drop_classes(recordings: Recordings, keep: np.ndarray, sides: Sides) -> list[Note]:
    """Remove classes without training frames from `keep`, and the empty hand where it has no test frames."""
    objects, notes = recordings.columns["object"], []
    for label, name in enumerate(recordings.objects):
        of_class = keep & (objects == label)
        trains, tests = (of_class & sides.training).any(), (of_class & (sides.side == TEST)).any()
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
    return notes


def one_class(name: str, where: str = "the recordings have") -> str:
    """The sentence on a single class: there is nothing to choose between."""
    return f"{where} one class, {name}; expected two or more"


def _require_classes(recordings: Recordings, keep: np.ndarray) -> None:
    """Raise a UserError if fewer than two classes are left."""
    left = np.unique(recordings.columns["object"][keep])
    if len(left) < 2:
        names = ", ".join(recordings.objects[i] for i in left) or "none"
        raise UserError(f"fewer than two classes left ({names}); loosen preprocess.filter or change split.by")


def _require_sides(keep: np.ndarray, sides: Sides, split: Split) -> None:
    """Raise a UserError if a side that is needed has no frames."""
    needed = {TRAIN, TEST} | ({VALIDATION} if split.validation else set())
    empty = [SIDES[code] for code in sorted(needed) if not (keep & (sides.side == code) & ~sides.surplus).any()]
    if empty:
        raise UserError(
            f"the {' and the '.join(empty)} side of split.by {split.by} (fold {split.fold} of {split.folds}) has no "
            "frames; expected some on each, so two groups of an object or more: record more, or choose another "
            "split.by, folds or fold"
        )
