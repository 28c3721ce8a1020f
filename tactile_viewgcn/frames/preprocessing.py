"""From the table of raw counts to the frames that a system learns from, and an account of those that were dropped."""

from dataclasses import asdict, dataclass, replace

import numpy as np

from tactile_viewgcn.frames.decide import Choice, choose
from tactile_viewgcn.frames.baseline import (
    Baseline,
    measure_baseline,
    session_moments,
    with_empty_hand,
)
from tactile_viewgcn.frames.filter import passing
from tactile_viewgcn.frames.open_hand import hand_states
from tactile_viewgcn.frames.split import SPLIT_SEED, Sides, deal, draw_anchors, keep_testable
from tactile_viewgcn.messages import Note
from tactile_viewgcn.params import PreprocessSection, Split
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import SIDES, TEST, VALIDATION, Frames
from tactile_viewgcn.tables.recordings import Recordings


@dataclass(frozen=True)
class Preprocessed:
    """The table of frames, and how it came about.

    Attributes:
        passed: bool (T,), frames that passed the filter.
        keep: bool (T,), frames that are in the table: they passed, and their class and their
            training group are used.
        notes: on what `auto` chose, on the baseline, the leak check and what was left out, and
            warnings.
    """

    frames: Frames
    choice: Choice
    sides: Sides
    passed: np.ndarray
    keep: np.ndarray
    notes: list[Note]


def preprocess_recordings(
    recordings: Recordings,
    asked: PreprocessSection,
    split: Split,
    *,
    groups: np.ndarray | None = None,
) -> Preprocessed:
    """Deal the sides, measure the baseline, filter the frames, draw the anchors, and make the table.

    What is `auto` is decided on the training side. Each side's baseline comes from that side's
    frames and the empty hand of its sessions, whichever side those frames are on. A trained model
    does the same with new recordings.

    Args:
        groups: see `deal`.

    Raises:
        UserError: no sensor that varies; a baseline, flags or groups that the recordings cannot
            give; fewer than two classes left; an empty side.
    """
    rng = stream(SPLIT_SEED, "preprocess")
    sides = deal(recordings, split, rng, empty_hand_class=asked.empty_hand_class, groups=groups)
    # the sensors that vary on the training side; every side uses the same
    recordings = replace(recordings, live=recordings.varying(np.flatnonzero(sides.training)))

    choice, baseline = _measure(recordings, asked, sides)

    passed, notes = passing(recordings, baseline, choice.params)
    # the empty hand stays only as a class
    keep = passed & (asked.empty_hand_class | ~recordings.empty_hand)
    keep, of_classes = keep_testable(recordings, sides, keep, split)

    published = groups is None and split.by == "source" and choice.params.filter == "flags"
    anchor = draw_anchors(recordings.columns, sides.side, keep, rng, published=published)
    # surplus: frames beyond split.train_groups and train_grasps. They go after the draw, so that
    # the anchors of the test side do not depend on how much is trained on
    keep &= ~sides.surplus

    index = np.flatnonzero(keep)
    # baselines of kept frames, from 0
    used, number = np.unique(baseline.of_frame[index], return_inverse=True)
    kept = recordings.part(index)
    columns = kept.columns
    objects, label = np.unique(columns["object"], return_inverse=True)
    frames = Frames(
        counts=kept.counts,
        label=label.astype(np.int16),
        recording=columns["recording"],
        session=columns["session"],
        grasp=columns.get("grasp", np.zeros_like(columns["recording"])),
        group=sides.group[index],
        side=sides.side[index],
        anchor=anchor[keep],
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
        kept_share=float(passed[sides.training].mean()),
        channel_names=recordings.channel_names or None,
    )
    return Preprocessed(
        frames, choice, sides, passed, keep, [*choice.notes, *baseline.notes, *notes, *of_classes]
    )


def _measure(
    recordings: Recordings, asked: PreprocessSection, sides: Sides
) -> tuple[Choice, Baseline]:
    """What is decided on the training side, and the baselines of all sides, one after another.

    Those of a side are measured on its frames and the empty hand of their sessions.
    """
    rows = with_empty_hand(recordings, sides.training)
    choice = choose(recordings, rows, asked, sides.group)
    baseline, measured, of_frame = (
        choice.baseline,
        list[Baseline](),
        np.zeros(len(recordings), dtype=np.int32),
    )
    for frames in (sides.training, sides.side == VALIDATION, sides.side == TEST, sides.surplus):
        if not frames.any():
            continue
        if measured:
            rows = with_empty_hand(recordings, frames)
            part, states = recordings.part(rows), None
            moments = session_moments(part)
            if choice.params.baseline == "grasp":
                states = hand_states(part, int(choice.params.contact_sensors), moments)
            baseline = measure_baseline(part, choice.params, moments, states)
        of_frame[frames] = (
            sum(len(each.mean) for each in measured) + baseline.of_frame[frames[rows]]
        )
        measured.append(baseline)
    mean, noise = (
        np.concatenate([getattr(each, name) for each in measured]) for name in ("mean", "noise")
    )
    return choice, Baseline(
        mean, noise, of_frame, [note for each in measured for note in each.notes]
    )


def frame_counts(frames: Frames) -> dict[str, int]:
    """Numbers of frames, anchors, groups and recordings on each side."""
    counts: dict[str, int] = {}
    for code, name in enumerate(SIDES):
        on = frames.side == code
        counts |= {
            f"frames.{name}": int(on.sum()),
            f"anchors.{name}": int((on & frames.anchor).sum()),
        }
        for each in ("group", "recording"):
            counts[f"{each}s.{name}"] = len(np.unique(getattr(frames, each)[on]))
    return counts
