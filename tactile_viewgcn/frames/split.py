"""The split into training, validation and test set, and the anchors in each set.

Frames of one recording resemble each other far more than frames of two recordings. So all frames of
a split group (a recording, a grasp, a session) are in one set. The published split is the
exception: its sets are used as they are, and a note says how many recordings are in both the
training and the test set. No reading is looked at.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.folds import in_fold, members_by_class, spans_classes
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, several
from tactile_viewgcn.params import SIDES, TEST, TRAIN, VALIDATION, Split
from tactile_viewgcn.tables.recordings import Recordings

# fewest anchors of a class; a class with fewer frames uses all of them
FEWEST_ANCHORS = 100
# seed of the anchors and validation groups, which are the same for every value of `seed`
SPLIT_SEED = 0
COLUMN_OF = {"grasp": "grasp", "source": "split"}  # the column that a value of `split.by` needs
SET_NAMES = {TRAIN: "training", VALIDATION: "validation", TEST: "test"}


@dataclass(frozen=True)
class Sides:
    """The set of every frame.

    Attributes:
        group: int64 (T,), split group.
        side: int8 (T,), TRAIN, VALIDATION or TEST.
        surplus: bool (T,), frames that are not used. They belong to training groups beyond
            `split.train_groups`, to a recording's grasps beyond `split.train_grasps`, or to the
            empty hand if it is not a class.
    """

    group: np.ndarray
    side: np.ndarray
    surplus: np.ndarray

    @property
    def training(self) -> np.ndarray:
        """Return the frames bool (T,) of the training set that are used."""
        return np.asarray((self.side == TRAIN) & ~self.surplus)


def deal(
    recordings: Recordings,
    split: Split,
    rng: np.random.Generator,
    *,
    empty_hand_class: bool,
    groups: np.ndarray | None = None,
) -> Sides:
    """Deal the split groups to the training, validation and test set.

    Args:
        recordings: the table of raw counts.
        split: the parameters of the split.
        rng: draws the validation groups.
        empty_hand_class: whether the empty hand is a class. If it is not, its frames are not used.
        groups: (T,), split group of each frame, for a training run without a test set. The share
            `split.validation` of these groups becomes the validation set. If it is None, `split.by`
            names the groups and the test set.

    Raises:
        UserError: there is only one class; `split.by` is `grasp` or `source`, and the recordings
            have no such column; `split.train_grasps` is a number, and grasps are not numbered; a
            set that is needed has no frames.
    """
    columns = recordings.columns
    surplus = np.array(recordings.empty_hand & (not empty_hand_class))
    used = np.flatnonzero(~surplus)
    label = np.asarray(columns["object"])[used]
    recorded = np.unique(label)
    if len(recorded) == 1:
        raise UserError(one_class(recordings.objects[recorded[0]]))
    if groups is None:
        group = split_groups(columns, split.by)
        across = split.by == "session"
    else:
        group = groups
        across = spans_classes(groups[used], label)
    side = np.full(len(group), TRAIN, dtype=np.int8)
    if groups is None and split.by == "source":
        side[published_test(columns["split"])] = TEST
    elif groups is None:
        is_test = in_fold(
            group[used], label, folds=split.folds, fold=split.fold, across=across, deal=split.deal
        )
        side[used[is_test]] = TEST
    side[used] = with_validation_set(
        side[used], group[used], label, share=split.validation, across=across, rng=rng
    )
    if split.train_groups != "all":
        surplus[used] = surplus_groups(side[used], group[used], label, most=split.train_groups)
    if split.train_grasps != "all":
        grasp = split_groups(columns, "grasp")
        recording = split_groups(columns, "recording")
        surplus |= surplus_groups(side, grasp, recording, most=split.train_grasps)
    if groups is None:
        _require_frames(side, ~surplus, split)
    return Sides(group, side, surplus)


def one_class(name: str, where: str = "the recordings have") -> str:
    """Return the message that there is only one class, so that there is no choice to learn.

    Args:
        name: the name of the class.
        where: subject and verb of the message.
    """
    return f"{where} one class, {name}; expected two or more"


def split_groups(columns: Mapping[str, np.ndarray], by: str) -> np.ndarray:
    """Return the split group int64 (T,) of each frame, numbered in the order of the recordings.

    A recording of several objects is one group for each object. Recordings that belong together are
    one group. With `source` the recordings are the groups.

    Args:
        columns: (T,), the columns of the recordings.
        by: a value of `split.by`.

    Raises:
        UserError: `by` is `grasp` or `source`, and the recordings have no such column.
    """
    column = COLUMN_OF.get(by)
    if column and column not in columns:
        remedy = "set split.by to recording or session, and split.train_grasps to all"
        raise UserError(f"the recordings have no column {column!r}: {remedy}")
    if by == "session":
        return np.asarray(columns["session"], dtype=np.int64)
    take = columns.get("take", columns["recording"])
    keys = pd.DataFrame({"take": np.asarray(take), "object": np.asarray(columns["object"])})
    if by == "grasp":
        keys["grasp"] = np.asarray(columns["grasp"])
    return np.asarray(keys.groupby(list(keys)).ngroup(), dtype=np.int64)


def with_validation_set(
    side: np.ndarray,
    groups: np.ndarray,
    labels: np.ndarray,
    *,
    share: float,
    across: bool,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return a copy of the sets (T,) with a share of each class's training groups as VALIDATION.

    A class with two groups or more gives at least one group and keeps at least one. Scikit-learn's
    `GroupShuffleSplit` draws from all classes at once, so it can take the last group of a class.

    Args:
        side: int8 (T,), TRAIN or TEST.
        groups: (T,), split groups.
        labels: (T,), classes.
        share: the share of the groups to draw.
        across: whether groups span classes. The share is then taken from all groups at once.
        rng: draws the groups.
    """
    side = side.copy()
    if not share:
        return side
    for _, of_class in members_by_class(labels, across=across):
        trained = of_class & (side == TRAIN)
        candidates = np.unique(groups[trained])
        count = min(len(candidates) - 1, max(1, round(share * len(candidates))))
        if count > 0:
            drawn = rng.permutation(candidates)[:count]
            side[trained & np.isin(groups, drawn)] = VALIDATION
    return side


def surplus_groups(
    side: np.ndarray, groups: np.ndarray, labels: np.ndarray, *, most: int
) -> np.ndarray:
    """Return the training frames bool (T,) that are not in the first groups of their class.

    Args:
        side: int8 (T,), the set of each frame.
        groups: (T,), groups.
        labels: (T,), classes, or recordings in their place.
        most: number of groups of a class that are used.
    """
    surplus = np.zeros(len(side), dtype=bool)
    for _, of_class in members_by_class(labels):
        trained = of_class & (side == TRAIN)
        first_groups = np.unique(groups[trained])[:most]
        surplus |= trained & ~np.isin(groups, first_groups)
    return surplus


def keep_testable(
    recordings: Recordings, sides: Sides, keep: np.ndarray, split: Split
) -> tuple[np.ndarray, list[Note]]:
    """Return the frames whose class has training frames.

    A class without test frames is kept, except for the empty hand. If there is no test set, all
    frames are kept.

    Args:
        recordings: the table of raw counts.
        sides: the set of every frame.
        keep: bool (T,), frames to choose from.
        split: the parameters of the split.

    Returns:
        The kept frames bool (T,), and notes on classes with missing frames and on the split.

    Raises:
        UserError: a set that is needed has no frames; fewer than two classes remain.
    """
    objects = np.asarray(recordings.columns["object"])
    is_test = sides.side == TEST
    kept = keep.copy()
    notes = list[Note]()
    if is_test.any():
        if split.by == "source":
            notes.append(_note_on_published_split(recordings, sides, keep))
        for label in np.unique(objects[keep]):
            name = recordings.objects[label]
            of_class = keep & (objects == label)
            has_training = bool((of_class & sides.training).any())
            has_test = bool((of_class & is_test).any())
            if has_training and has_test:
                continue
            is_dropped = name == EMPTY_HAND or not has_training
            if is_dropped:
                kept &= ~of_class
            missing = "test" if has_training else "training"
            what_becomes = "kept as a class that others can be mistaken for"
            if is_dropped:
                what_becomes = "dropped"
            text = f"{name} has no {missing} frames and is {what_becomes}"
            notes.append(Note(text, topic="objects"))
        _require_frames(sides.side, kept & ~sides.surplus, split)
    classes = np.unique(objects[kept])
    if len(classes) < 2:
        names = ", ".join(recordings.objects[label] for label in classes) or "none"
        raise UserError(
            f"fewer than two classes are left ({names}); choose a less strict preprocess.filter or "
            "another split.by"
        )
    return kept, notes


def _note_on_published_split(recordings: Recordings, sides: Sides, keep: np.ndarray) -> Note:
    """Return a note on recordings in both published sets, and on published validation groups."""
    recording = np.asarray(recordings.columns["recording"])
    is_test = sides.side == TEST
    trained = recording[keep & (sides.side == TRAIN)]
    shared = np.intersect1d(trained, recording[keep & is_test])
    text = f"the published split has {several(len(shared), 'recording')} in both the training and "
    text += "the test set"
    is_published_validation = np.asarray(recordings.columns["split"]) == VALIDATION
    if (is_published_validation & ~is_test).any():
        text += "; its validation groups join the training set, from which split.validation draws "
        text += "new ones"
    return Note(text, topic="split")


def has_published_split(recordings: Recordings) -> bool:
    """Return whether the source has a training and a test set, with every object in both.

    Args:
        recordings: the table of raw counts.
    """
    columns = recordings.columns
    if "split" not in columns:
        return False
    of_object = ~np.asarray(recordings.empty_hand)
    objects = np.asarray(columns["object"])[of_object]
    is_test = published_test(columns["split"])[of_object]
    return np.array_equal(np.unique(objects[is_test]), np.unique(objects[~is_test]))


def published_test(split: np.ndarray) -> np.ndarray:
    """Return the frames bool (T,) of the published test set; without one, of the validation set.

    Args:
        split: (T,), the published set of each frame: TRAIN, VALIDATION or TEST.
    """
    published = np.asarray(split)
    tested = TEST if (published == TEST).any() else VALIDATION
    return np.asarray(published == tested)


def draw_anchors(
    columns: Mapping[str, np.ndarray],
    side: np.ndarray,
    keep: np.ndarray,
    rng: np.random.Generator,
    *,
    published: bool,
) -> np.ndarray:
    """Return the anchors bool (T,) among the kept frames.

    The anchors are drawn at random, equally many of every class in a set. Their number is the
    number of frames of the smallest class. It is at least 100, so that one small class does not
    reduce all other classes to a handful. A class with fewer frames uses all of them.

    Args:
        columns: (T,), the columns of the recordings.
        side: int8 (T,), the set of each frame.
        keep: bool (T,), frames that are kept.
        rng: draws the anchors.
        published: whether to take the balanced frames that the source names, if it names any.
    """
    if published and "balanced" in columns:
        return np.asarray(keep & columns["balanced"])
    classes = members_by_class(np.asarray(columns["object"]))
    anchor = np.zeros(len(keep), dtype=bool)
    for code in range(len(SIDES)):
        in_set = keep & (side == code)
        frames_of_class = [np.flatnonzero(in_set & of_class) for _, of_class in classes]
        sizes = [len(frames) for frames in frames_of_class if len(frames)]
        count = max(FEWEST_ANCHORS, min(sizes, default=0))
        for frames in frames_of_class:
            anchor[rng.permutation(frames)[:count]] = True
    return anchor


def _require_frames(side: np.ndarray, frames: np.ndarray, split: Split) -> None:
    """Raise a UserError if a set that is needed has none of the frames bool (T,)."""
    needed = [TRAIN, TEST]
    if split.validation:
        needed = [TRAIN, VALIDATION, TEST]
    empty = [SET_NAMES[code] for code in needed if not (frames & (side == code)).any()]
    if empty:
        raise UserError(
            f"no frames in the {' and the '.join(empty)} set of split.by {split.by} "
            f"(fold {split.fold} of {split.folds}); each set needs frames, so objects need two "
            "groups or more. Record more, or choose another split.by, split.folds or split.fold"
        )
