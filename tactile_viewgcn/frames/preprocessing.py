"""From the table of raw counts to the frames that a system learns from, and an account of those that were dropped."""

from dataclasses import asdict, dataclass, replace

import numpy as np

from tactile_viewgcn.frames.auto import Choice, choose
from tactile_viewgcn.frames.baseline import Baseline, join_baselines, measure_baseline
from tactile_viewgcn.frames.empty_hand import has_empty_hand, with_empty_hand
from tactile_viewgcn.frames.filter import passing
from tactile_viewgcn.frames.open_hand import hand_states
from tactile_viewgcn.frames.sides import Sides, deal, has_published_split, keep_testable
from tactile_viewgcn.frames.split import SPLIT_SEED, balanced_anchors, published_anchors
from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.params import PreprocessSection, Split
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import SIDES, Frames
from tactile_viewgcn.tables.recordings import Recordings


@dataclass(frozen=True)
class Preprocessed:
    """The table of frames, and how it came about.

    Attributes:
        passed: bool (T,), frames that passed the filter.
        keep: bool (T,), frames that are in the table: they passed, and their class and their training group are used.
        notes: on what `auto` chose, on the baseline, the leak check and what was left out, and warnings.
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
    """Deal the sides, measure the baseline, filter the frames, draw the anchors, and make the table.

    What is `auto` is decided on the training side. Each side's baseline is measured on that side alone, and on the
    empty hand of its sessions, as a model measures that of new recordings.

    Args:
        groups: see `deal`.

    Raises:
        UserError: no sensor that varies; a baseline, flags or groups that the recordings cannot give; fewer than two
            classes left; an empty side.
    """
    rng, empty = stream(SPLIT_SEED, "preprocess"), recordings.empty_hand
    sides = deal(recordings, split, rng, empty_hand_class=asked.empty_hand_class, groups=groups)
    live = recordings.part(np.flatnonzero(sides.training)).live
    recordings = recordings.part(np.arange(len(recordings)), live)

    choice, baseline = _measure(recordings, asked, sides)
    passed, notes = passing(recordings, baseline, choice.params)

    keep = passed & (asked.empty_hand_class | ~empty)
    _require_classes(recordings, keep)
    if groups is None:
        keep, of_split = keep_testable(recordings, sides, keep, split)
        notes += of_split
        _require_classes(recordings, keep)

    label, side = recordings.columns["object"][keep], sides.side[keep]
    published = groups is None and split.by == "source" and choice.params.filter == "flags"
    if published and "balanced" in recordings.columns:
        anchors = published_anchors(recordings.columns["balanced"][keep], side)
        notes.append(Note("the source's balanced frames", topic="anchors"))
    else:
        anchors, unequal = balanced_anchors(label, side, rng=rng)
        notes += unequal
    anchors = anchors[~sides.surplus[keep]]  # after the draw: those of the other sides stay the same
    keep &= ~sides.surplus

    share = float(passed[sides.training].mean())
    frames = _table(recordings, choice, baseline, sides, keep, anchors, share)
    return Preprocessed(frames, choice, sides, passed, keep, [*choice.notes, *baseline.notes, *notes])


def _measure(recordings: Recordings, asked: PreprocessSection, sides: Sides) -> tuple[Choice, Baseline]:
    """What is decided on the training side, and the baseline of all frames."""
    empty_hand, published = has_empty_hand(recordings), has_published_split(recordings)
    rows = with_empty_hand(recordings, sides.training)
    part = recordings.part(rows, recordings.live)
    choice = choose(part, asked, sides.group[rows], empty_hand=empty_hand, published=published)
    parts, states = [(sides.training, rows, choice.baseline)], None
    for name, frames in sides.others():
        rows = with_empty_hand(recordings, frames)
        part = recordings.part(rows, recordings.live)
        if choice.params.baseline == "grasp":
            states = hand_states(part, choice.states.contact_sensors, all_contact=choice.states.all_contact)
        baseline = measure_baseline(part, choice.params, states)
        baseline.notes[:] = [replace(note, topic=f"{note.topic} ({name})") for note in baseline.notes]
        parts.append((frames, rows, baseline))
    return choice, join_baselines(parts, len(recordings))


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
