"""From the table of raw counts to the frames that a system learns from, and an account of those that were dropped."""

from dataclasses import asdict, dataclass, replace

import numpy as np

from tactile_viewgcn.frames.baseline import Baseline, of_empty_hand
from tactile_viewgcn.frames.choose import Choice, choose, measure_baseline
from tactile_viewgcn.frames.contact import passing
from tactile_viewgcn.frames.open_hand import find_open_hand
from tactile_viewgcn.frames.scale_check import clipping_warnings
from tactile_viewgcn.frames.sides import Sides, deal, keep_testable, with_empty_hand
from tactile_viewgcn.frames.split import SPLIT_SEED
from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.params import PreprocessSection, Split
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import SIDES, TEST, VALIDATION, Frames
from tactile_viewgcn.tables.recordings import Recordings

MINIMUM = 100  # anchors that a class keeps at least; a class with fewer frames uses all of them


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
    if not sides.training.any():
        keep_testable(recordings, sides, np.ones(len(recordings), dtype=bool), split)  # raises
    choice = choose(recordings, asked, sides)
    recordings = recordings.part(np.arange(len(recordings)), choice.recordings.live)
    baseline = _of_all_sides(recordings, choice, sides)
    passed, notes = passing(recordings, baseline, choice.params)
    keep = passed & (asked.empty_hand_class | ~empty)
    _require_classes(recordings, keep)
    if groups is None:
        keep, of_split = keep_testable(recordings, sides, keep, split)
        notes += of_split
        _require_classes(recordings, keep)
    published = groups is None and split.by == "source" and choice.params.filter == "flags"
    if published and "balanced" in recordings.columns:
        anchors = published_anchors(recordings.columns["balanced"][keep], sides.side[keep])
        notes.append(Note("the source's balanced frames", topic="anchors"))
    else:
        anchors, unequal = balanced_anchors(objects[keep], sides.side[keep], rng=rng)
        notes += unequal
    anchors = anchors[~sides.surplus[keep]]  # after the draw: those of the other sides stay the same
    keep &= ~sides.surplus
    share = float(passed[sides.training].mean())
    frames = _table(recordings, choice, baseline, sides, keep, anchors, share)
    notes = [*choice.notes, *baseline.notes, *notes]
    if choice.hand and asked.scale != "auto":
        notes += clipping_warnings(frames, choice.hand.noise)
    return Preprocessed(frames, choice, sides, passed, keep, notes)


def _of_all_sides(recordings: Recordings, choice: Choice, sides: Sides) -> Baseline:
    """Baselines of all frames: each side's are measured on its frames and its sessions' empty hand, as on new ones."""
    of_frame, measured = np.zeros(len(recordings), dtype=np.int32), list[Baseline]()
    params, trained = choice.params, choice.hand
    for name, frames in (
        ("training", sides.training), ("validation", sides.side == VALIDATION), ("test", sides.side == TEST),
        ("left out", sides.surplus),
    ):  # fmt: skip
        if not frames.any():
            continue
        rows, baseline = with_empty_hand(recordings, frames), choice.baseline
        if measured:
            part, hand = recordings.part(rows, recordings.live), None
            if trained and params.baseline == "grasp":
                hand = find_open_hand(part, trained.sensors, all_contact=trained.all_contact)
            baseline = measure_baseline(part, params.baseline, hand, params.zero)
            baseline.notes[:] = [replace(note, topic=f"{note.topic} ({name})") for note in baseline.notes]
        of_frame[frames] = sum(len(before.names) for before in measured) + baseline.of_frame[frames[rows]]
        measured.append(baseline)
    names, notes = ([value for each in measured for value in getattr(each, name)] for name in ("names", "notes"))
    mean, noise = (np.concatenate([getattr(each, name) for each in measured]) for name in ("mean", "noise"))
    return Baseline(names, mean, noise, of_frame, notes)


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


def _table(
    recordings: Recordings,
    choice: Choice,
    baseline: Baseline,
    sides: Sides,
    keep: np.ndarray,
    anchors: np.ndarray,
    share: float,
) -> Frames:
    """Table of the frames to `keep` (T,), with classes in the order of the recordings; `share` passed the filter."""
    index = np.flatnonzero(keep)
    used, number = np.unique(baseline.of_frame[index], return_inverse=True)
    kept = recordings.part(index, recordings.live)
    columns = kept.columns
    objects, label = np.unique(columns["object"], return_inverse=True)
    return Frames(
        counts=kept.counts,
        label=label.astype(np.int16),
        recording=columns["recording"],
        session=columns["session"],
        grasp=columns.get("grasp", np.zeros_like(columns["recording"])),
        group=sides.group[index],
        side=sides.side[index],
        anchor=anchors,
        baseline=number.astype(np.int32),
        time=columns["time"],
        baseline_mean=baseline.mean[used],
        live=recordings.live,
        classes=[recordings.objects[i] for i in objects],
        recordings=recordings.recordings,
        sessions=recordings.sessions,
        transform=choice.params.transform,
        scale=float(choice.params.scale),
        noise=baseline.noise[np.unique(baseline.of_frame[sides.training])].mean(axis=0),
        preprocess=asdict(choice.params),
        kept_share=share,
        channel_names=recordings.channel_names or None,
    )


def one_class(name: str, where: str = "the recordings have") -> str:
    """The sentence on a single class: there is nothing to choose between."""
    return f"{where} one class, {name}; expected two or more"


def _require_classes(recordings: Recordings, keep: np.ndarray) -> None:
    """Raise a UserError if fewer than two classes are left."""
    left = np.unique(recordings.columns["object"][keep])
    if len(left) < 2:
        names = ", ".join(recordings.objects[i] for i in left) or "none"
        raise UserError(f"fewer than two classes left ({names}); loosen preprocess.filter or change split.by")


def frame_counts(frames: Frames) -> dict[str, int]:
    """Numbers of frames, anchors, groups and recordings on each side."""
    counts: dict[str, int] = {}
    for code, name in enumerate(SIDES):
        on = frames.side == code
        counts |= {
            f"frames.{name}": int(on.sum()),
            f"anchors.{name}": int((on & frames.anchor).sum()),
            f"groups.{name}": len(np.unique(frames.group[on])),
            f"recordings.{name}": len(np.unique(frames.recording[on])),
        }
    return counts


def kept_rows(recordings: Recordings, made: Preprocessed) -> list[dict[str, object]]:
    """Rows of a table, one per object and session: frames, how many were dropped and why, kept, and anchors."""
    pairs = np.stack([recordings.columns["object"], recordings.columns["session"]])
    cells, cell = np.unique(pairs, axis=1, return_inverse=True)
    anchor = np.zeros(len(recordings), dtype=bool)
    anchor[made.keep] = made.frames.anchor
    masks = {
        "frames": np.ones(len(recordings), dtype=bool),
        "dropped_by_filter": ~made.passed,
        "dropped_with_class": made.passed & ~made.keep,
        "kept": made.keep,
        **{f"anchors_{name}": anchor & (made.sides.side == code) for code, name in enumerate(SIDES)},
    }
    names = [{"object": recordings.objects[one], "session": recordings.sessions[session]} for one, session in cells.T]
    counts = {name: np.bincount(cell.ravel(), mask).astype(int).tolist() for name, mask in masks.items()}
    return [row | {name: of_cell[at] for name, of_cell in counts.items()} for at, row in enumerate(names)]
