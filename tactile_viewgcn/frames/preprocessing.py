"""Turn the table of raw counts into the table of frames that a system learns from."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.apply import apply
from tactile_viewgcn.frames.baseline import Baseline, with_empty_hand
from tactile_viewgcn.frames.decide import Choice, decide
from tactile_viewgcn.frames.filter import passing, require_filter
from tactile_viewgcn.frames.open_hand import HandStates
from tactile_viewgcn.frames.split import SPLIT_SEED, Sides, deal, draw_anchors, keep_testable
from tactile_viewgcn.frames.training_readings import measured_on, training_rates
from tactile_viewgcn.messages import Note
from tactile_viewgcn.params import PreprocessSection, Split
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import SIDES, TEST, VALIDATION, Frames
from tactile_viewgcn.tables.plan import Plan
from tactile_viewgcn.tables.recordings import Recordings


@dataclass(frozen=True)
class Preprocessed:
    """The table of frames, and the decisions behind it.

    Attributes:
        frames: the kept frames, with the plan.
        choice: the decisions that were made on the training set.
        sides: the set of every frame.
        passed: bool (T,), frames that passed the filter.
        keep: bool (T,), frames in the table. They passed the filter, and their class and their
            training group are used.
        notes: notes on the choices of `auto`, on the baseline, on the leak check and on whatever
            was left out, and warnings.
    """

    frames: Frames
    choice: Choice
    sides: Sides
    passed: np.ndarray
    keep: np.ndarray
    notes: list[Note]


def preprocess_recordings(
    recordings: Recordings,
    settings: PreprocessSection,
    split: Split,
    *,
    groups: np.ndarray | None = None,
) -> Preprocessed:
    """Return the table of frames: split, decide the plan, apply it to each set, draw the anchors.

    The baseline of a set comes from the frames of the set and from the empty hand of its sessions.
    The empty hand is used even if it is in another set.

    Args:
        recordings: T frames.
        settings: the section of params.yaml. Every `auto` is decided on the training set.
        split: the parameters of the split.
        groups: see `deal`.

    Raises:
        UserError: no sensor varies; the recordings lack the baseline, flags or groups that the
            settings name; fewer than two classes are left; a set is empty.
    """
    rng = stream(SPLIT_SEED, "preprocess")
    sides = deal(recordings, split, rng, empty_hand_class=settings.empty_hand_class, groups=groups)
    # the sensors that vary in the training set; every set uses the same
    recordings = replace(recordings, live=recordings.varying(np.flatnonzero(sides.training)))

    rows = with_empty_hand(recordings, sides.training)
    choice = decide(recordings, rows, settings, sides.group)
    plan = choice.plan
    require_filter(recordings, plan.params)
    baseline, contact = _apply_to_sets(recordings, choice, sides)

    passed, filter_notes = passing(recordings, contact, plan.params)
    # from here on, the empty hand is needed only if it is a class
    keep = passed & (settings.empty_hand_class | ~recordings.empty_hand)
    keep, class_notes = keep_testable(recordings, sides, keep, split)

    published = groups is None and split.by == "source" and plan.params.filter == "flags"
    anchor = draw_anchors(recordings.columns, sides.side, keep, rng, published=published)
    # frames beyond split.train_groups and train_grasps are dropped after the draw, so that the
    # anchors of the test set do not depend on the size of the training set
    keep &= ~sides.surplus

    of_training = np.unique(baseline.of_frame[sides.training])
    plan = replace(
        plan,
        kept_share=float(passed[sides.training].mean()),
        noise=baseline.noise[of_training].mean(axis=0),
        rates=training_rates(recordings, sides.training),
    )
    index = np.flatnonzero(keep)
    frames = _kept_frames(recordings, index, baseline, plan, sides=sides, anchor=anchor)
    frames = replace(frames, plan=measured_on(frames))
    notes = [*choice.notes, *baseline.notes(recordings), *filter_notes, *class_notes]
    return Preprocessed(frames, choice, sides, passed, keep, notes)


def _kept_frames(
    recordings: Recordings,
    index: np.ndarray,
    baseline: Baseline,
    plan: Plan,
    *,
    sides: Sides,
    anchor: np.ndarray,
) -> Frames:
    """Return the table of the frames at rising indices (n,), with their baselines and classes."""
    kept = recordings.part(index)
    used, number = np.unique(baseline.of_frame[index], return_inverse=True)
    objects, label = np.unique(kept.columns["object"], return_inverse=True)
    recording = kept.columns["recording"]
    columns = pd.DataFrame(
        {
            "label": label.astype(np.int16),
            "recording": recording,
            "session": kept.columns["session"],
            "grasp": kept.columns.get("grasp", np.zeros_like(recording)),
            "group": sides.group[index],
            "side": sides.side[index],
            "anchor": anchor[index],
            "baseline": number.astype(np.int32),
            "time": kept.columns["time"],
        }
    )
    return Frames(
        counts=kept.counts,
        columns=columns,
        baseline_mean=baseline.mean[used],
        classes=[recordings.objects[number] for number in objects],
        recordings=recordings.recordings,
        sessions=recordings.sessions,
        plan=plan,
    )


def _apply_to_sets(
    recordings: Recordings, choice: Choice, sides: Sides
) -> tuple[Baseline, np.ndarray]:
    """Apply the plan to one set after another.

    A set is measured on its frames and on the empty hand of their sessions.

    Returns:
        The baselines of all T frames, and the frames in contact, bool (T,).
    """
    of_frame = np.zeros(len(recordings), dtype=np.int32)
    contact = np.zeros(len(recordings), dtype=bool)
    means = list[np.ndarray]()
    noises = list[np.ndarray]()
    fallbacks = dict[tuple[str, str], list[int]]()
    sets = [sides.training, sides.side == VALIDATION, sides.side == TEST, sides.surplus]
    states: HandStates | None = choice.states
    for in_set in sets:
        if not in_set.any():
            continue
        rows = with_empty_hand(recordings, in_set)
        baseline, of_set = apply(choice.plan, recordings.part(rows), states=states)
        states = None  # known for the training set only
        of_frame[in_set] = sum(map(len, means)) + baseline.of_frame[in_set[rows]]
        contact[in_set] = of_set[in_set[rows]]
        means.append(baseline.mean)
        noises.append(baseline.noise)
        recorded = set(recordings.columns["recording"][in_set].tolist())
        for kind, numbers in baseline.fallbacks.items():
            # the empty hand can be of another set
            others = recorded.intersection(numbers).difference(fallbacks.get(kind, []))
            fallbacks.setdefault(kind, []).extend(sorted(others))
    fallbacks = {kind: numbers for kind, numbers in fallbacks.items() if numbers}
    mean = np.concatenate(means)
    return Baseline(mean, np.concatenate(noises), of_frame, fallbacks), contact


def frame_counts(frames: Frames) -> dict[str, int]:
    """Return the numbers of frames, anchors, groups and recordings in each set."""
    counts: dict[str, int] = {}
    for code, name in enumerate(SIDES):
        of_set = frames.columns[frames.side == code]
        counts[f"frames.{name}"] = len(of_set)
        counts[f"anchors.{name}"] = int(of_set["anchor"].sum())
        counts[f"groups.{name}"] = of_set["group"].nunique()
        counts[f"recordings.{name}"] = of_set["recording"].nunique()
    return counts
