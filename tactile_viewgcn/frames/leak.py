"""Checks by a quick classifier on held-out groups: do frames without contact predict the object?

If they do, a low error of a system says little about touch.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.baseline import Baseline
from tactile_viewgcn.frames.folds import complete_folds
from tactile_viewgcn.frames.open_hand import HandStates
from tactile_viewgcn.frames.split import SPLIT_SEED
from tactile_viewgcn.intervals import proportion_interval
from tactile_viewgcn.messages import Note, several
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings

TOPIC = "leak check"
MAX_FRAMES = 2000  # in all; of each pair of an object and a group equally many
FRAMES = 8  # most frames in a mean: as many as the paper's views
FOLDS = 3
PENALTY = 2.0  # of ridge regression, for each sensor
ROUNDING = 1e-9  # of a share
PERMUTATIONS = 99  # of the objects, by which an error that is little below chance is judged
MOST_BY_CHANCE = 0.02  # share of the permutations that may have an error as low


@dataclass(frozen=True)
class QuickError:
    """Error of a ridge classifier on means of eight frames.

    Attributes:
        error: mean over the pairs of an object and a group of it, which count alike.
        low, high: 95 % interval, which resamples groups.
        chance: error of always answering the object with the most groups.
        groups, frames: numbers of those that were used.
        objects_left_out: number of objects that have usable frames in a single group, which no fold
            can hold out.
        by_chance: share of random assignments of the objects to the groups that have an error as
            low; 0 where that was not asked, as of an error far below chance.
    """

    error: float
    low: float
    high: float
    chance: float
    groups: int
    frames: int
    objects_left_out: int = 0
    by_chance: float = 0.0

    @property
    def beats_chance(self) -> bool:
        """Whether the readings predict the object: the whole interval lies below chance, and few permutations do."""
        return self.high < self.chance - ROUNDING and self.by_chance <= MOST_BY_CHANCE


def quick_error(
    readings: Callable[[np.ndarray], np.ndarray],
    usable: np.ndarray,
    label: np.ndarray,
    group: np.ndarray,
    *,
    nearest: bool = False,
) -> QuickError | None:
    """Error of recognising the objects in about 2,000 frames; None unless two objects have two groups each.

    Each mean is over frames that are spread over an object's frames in a group. About a third of
    the groups is held out at a time, for all objects at once, such that each object of two groups
    or more is answered in all of them. An object of a single group is left out: it is neither
    learnt nor answered.

    Args:
        readings: function from frames (n,) to their readings (n, S).
        usable: bool (T,) frames to draw from.
        label, group: (T,) object and group of each frame.
        nearest: the answer is the nearest mean's object, however objects alternate; else by ridge
            regression.
    """
    frames = np.flatnonzero(usable)
    pairs = np.stack([label, group])[:, frames].astype(np.int64)
    order = np.lexsort(pairs[::-1])  # by object, then by group, in the order of time
    cells, begins = np.unique(pairs[:, order], axis=1, return_index=True)
    frames_of_cell = np.split(frames[order], begins[1:])
    objects_used = len(np.unique(cells[0]))
    is_answered = np.bincount(cells[0])[cells[0]] > 1
    cells = cells[:, is_answered]
    objects_left_out = objects_used - len(np.unique(cells[0]))
    if len(np.unique(cells[0])) < 2:
        return None
    rows, of_cell = list[np.ndarray](), list[int]()
    for number, cell in enumerate(np.flatnonzero(is_answered)):
        index = evenly(frames_of_cell[cell], max(1, MAX_FRAMES // len(cells.T)))
        count = -(-len(index) // FRAMES)
        rows += [index[first::count] for first in range(count)]
        of_cell += [number] * count
    used = np.concatenate(rows)
    values = np.split(readings(used), np.cumsum([len(row) for row in rows])[:-1])
    means = np.stack([value.mean(axis=0, dtype=np.float64) for value in values])

    def wrong_by(labels: np.ndarray) -> np.ndarray:
        """The share of wrong answers of each cell, if the cells are of the objects `labels`."""
        expected = labels[of_cell]
        is_wrong = _answers(means, expected, cells[1, of_cell], nearest=nearest) != expected
        return np.bincount(of_cell, is_wrong) / np.bincount(of_cell)

    wrong = wrong_by(cells[0])
    low, high = proportion_interval(wrong, cells[1], stream(SPLIT_SEED, "quick error")) or (
        0.0,
        1.0,
    )
    chance = 1 - np.bincount(cells[0]).max() / len(cells.T)
    groups = len(np.unique(cells[1]))
    error = QuickError(
        float(wrong.mean()), low, high, float(chance), groups, len(used), objects_left_out
    )
    if not nearest and error.beats_chance and error.error > chance / 2:
        return replace(error, by_chance=_share_by_chance(error.error, wrong_by, cells))
    return error


def _share_by_chance(
    error: float, wrong_by: Callable[[np.ndarray], np.ndarray], cells: np.ndarray
) -> float:
    """The share of random assignments of objects to groups whose error is as low as `error`.

    An object keeps its number of groups. Where groups span objects, as sessions do, objects change
    places within each.

    Args:
        wrong_by: function from the objects (n,) of the cells to the share of wrong answers (n,) in
            each.
        cells: int (2, n), object and group of each cell.
    """
    rng = stream(SPLIT_SEED, "permutations")
    spans = len(np.unique(cells[1])) < cells.shape[1]
    blocks = cells[1] if spans else np.zeros_like(cells[1])
    as_low = 0
    for _ in range(PERMUTATIONS):
        objects = cells[0].copy()
        for block in np.unique(blocks):
            members = np.flatnonzero(blocks == block)
            objects[members] = rng.permutation(objects[members])
        as_low += wrong_by(objects).mean() <= error + ROUNDING
    return as_low / PERMUTATIONS


def _answers(
    means: np.ndarray, label: np.ndarray, group: np.ndarray, *, nearest: bool
) -> np.ndarray:
    """Objects (n,) that a classifier of other groups assigns to mean readings (n, S).

    Every object has two groups or more, so that each mean is answered, see `complete_folds`.

    With `nearest` the answer is the nearest mean's object. Else it is the object whose ridge scores
    are nearest on average. The largest score alone would never name an object that reads between
    two others, as where all sensors of an object share an offset (Hastie, Tibshirani and Friedman,
    "The elements of statistical learning", section 4.2, masking).
    """
    from sklearn.linear_model import Ridge
    from sklearn.neighbors import KNeighborsClassifier
    from sklearn.preprocessing import StandardScaler
    from threadpoolctl import threadpool_limits

    answer = np.full(len(label), -1)
    # no choice depends on the number of threads
    with threadpool_limits(1), warnings.catch_warnings():
        # many objects of two groups each
        warnings.filterwarnings("ignore", "The number of unique classes")
        for test in complete_folds(group, label, FOLDS):
            scaler = StandardScaler().fit(means[~test])
            points = scaler.transform(means)
            learnt, known = points[~test], label[~test]
            if not nearest:
                objects = np.unique(known)
                is_object = (known[:, None] == objects).astype(np.float64)
                scores = Ridge(PENALTY * means.shape[1]).fit(learnt, is_object).predict
                points = scores(points).reshape(len(means), -1)
                learnt = np.stack([points[~test][known == one].mean(axis=0) for one in objects])
                known = objects
            answer[test] = KNeighborsClassifier(1).fit(learnt, known).predict(points[test])
    return answer


def check_leak(
    recordings: Recordings, baseline: Baseline, states: HandStates, group: np.ndarray
) -> QuickError | None:
    """Error of recognising objects by open-hand frames; None unless two objects have such frames in two groups each.

    The baseline of the last frame of contact before is subtracted: one of the open hand itself
    would hide its own drift. The empty hand is no object here.

    Args:
        group: (T,) split group of each frame.
    """
    frame = pd.Series(np.arange(len(recordings)))
    last = frame.where(states.contact).groupby(recordings.columns["recording"]).ffill()
    before = last.fillna(frame).to_numpy(int)

    def excess(index: np.ndarray) -> np.ndarray:
        return (
            states.counts[index]
            - baseline.mean[baseline.of_frame[before[index]]][:, recordings.live]
        )

    untouched = states.open & ~recordings.empty_hand
    return quick_error(excess, untouched, recordings.columns["object"], group)


def leak_note(leak: QuickError, *, advised: bool) -> Note:
    """A leak check in one line; a warning with a remedy where the objects are recognised.

    Args:
        advised: to set the baseline to `grasp` is a remedy.
    """
    text = (
        f"frames without contact predict the object with an error of {100 * leak.error:.1f} % "
        f"({100 * leak.low:.1f} to {100 * leak.high:.1f}), chance {100 * leak.chance:.1f} %; "
        f"{several(leak.frames, 'frame')} in {several(leak.groups, 'group')}"
    )
    if leak.objects_left_out:
        text += f"; not in it: {several(leak.objects_left_out, 'object')} with such frames in a single group"
    if not leak.beats_chance:
        return Note(text, topic=TOPIC)
    text += ". Errors say less about touch than they seem to: "
    if advised:
        text += "set preprocess.baseline to grasp, or "
    text += "choose another split.by"
    remedy = ("preprocess.baseline", "grasp") if advised else ("", None)
    return Note(text, "warning", TOPIC, *remedy)
