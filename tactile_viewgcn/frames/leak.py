"""Check by a quick classifier on held-out groups whether frames without contact predict the object.

If they do, a low error rate of a system says little about touch.
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
MOST_FRAMES_READ = 2000  # in all; about equally many of each pair of an object and a group
FRAMES_OF_MEAN = 8  # at most; the paper has as many views
LEAK_FOLDS = 3
RIDGE_PENALTY = 2.0  # for each sensor
ROUNDING = 1e-9  # of a share
PERMUTATIONS = 99  # of the objects; an error a little below chance is compared with theirs
MOST_BY_CHANCE = 0.02  # largest share of the permutations with an error as low


@dataclass(frozen=True)
class QuickError:
    """The error of a quick classifier on held-out groups.

    Attributes:
        error: mean over the pairs of an object and one of its groups. Each pair has the same
            weight.
        low: lower end of the 95 % interval, which resamples groups.
        high: upper end of that interval.
        chance: error of always answering the object with the most groups.
        groups: number of groups that were used.
        frames: number of frames that were used.
        objects_left_out: number of objects that have usable frames in a single group only, which no
            fold can hold out.
        by_chance: share of random assignments of the objects to the groups that have an error as
            low. It is 0 if it was not computed, for example because the error is far below chance.
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
        """Return whether the readings predict the object.

        They do if the whole interval lies below chance, and few permutations have an error as low.
        """
        return self.high < self.chance - ROUNDING and self.by_chance <= MOST_BY_CHANCE


@dataclass(frozen=True, kw_only=True)
class _Means:
    """Mean readings of cells: a cell is an object in a group.

    Attributes:
        values: float64 (n, S), means of S sensors over at most eight frames.
        cell: int (n,), the cell of each mean.
        label: int (C,), the object of each cell.
        group: int (C,), the group of each cell.
        frames: number of frames in all means.
    """

    values: np.ndarray
    cell: np.ndarray
    label: np.ndarray
    group: np.ndarray
    frames: int


def quick_error(
    readings: Callable[[np.ndarray], np.ndarray],
    usable: np.ndarray,
    *,
    label: np.ndarray,
    group: np.ndarray,
    nearest: bool = False,
) -> QuickError | None:
    """Return the error of recognising the objects by mean readings over up to eight frames.

    About 2,000 frames are read. The frames of a mean are spread over the frames of an object in a
    group. About a third of the groups is held out at a time, for all objects at once. Each object
    of two groups or more is answered in all of its groups. An object of a single group is neither
    learnt nor answered.

    Args:
        readings: function from frames (n,) to their readings (n, S).
        usable: bool (T,), frames to draw from.
        label: int (T,), object of each frame.
        group: int (T,), group of each frame.
        nearest: whether the answer is the object of the nearest mean, which works however the
            objects alternate. Otherwise ridge regression answers.

    Returns:
        The error; None unless two objects have two groups each.
    """
    frames = np.flatnonzero(usable)
    table = pd.DataFrame({"label": label, "group": group}, dtype=np.int64).iloc[frames]
    cells = table.drop_duplicates().sort_values(["label", "group"])
    is_answered = (cells.groupby("label")["group"].transform("size") > 1).to_numpy()
    answered = cells[is_answered]
    if answered["label"].nunique() < 2:
        return None
    cell = table.groupby(["label", "group"]).ngroup().to_numpy()
    frames_of_cell = _frames_of_cells(frames, cell)
    used = [frames_of_cell[index] for index in np.flatnonzero(is_answered)]
    means = _means_of(readings, used, answered)
    wrong = _wrong_by_cell(means, means.label, nearest=nearest)
    interval = proportion_interval(wrong, means.group, stream(SPLIT_SEED, "quick error"))
    low, high = interval or (0.0, 1.0)
    error = QuickError(
        error=float(wrong.mean()),
        low=low,
        high=high,
        chance=float(1 - np.bincount(means.label).max() / len(answered)),
        groups=answered["group"].nunique(),
        frames=means.frames,
        objects_left_out=cells["label"].nunique() - answered["label"].nunique(),
    )
    may_be_chance = error.beats_chance and error.error > error.chance / 2
    if may_be_chance and not nearest:
        return replace(error, by_chance=_share_by_chance(error.error, means))
    return error


def _frames_of_cells(frames: np.ndarray, cell: np.ndarray) -> list[np.ndarray]:
    """Return the frames of each cell, in the order of time.

    Args:
        frames: int (n,), rising.
        cell: int (n,), the cell of each of these frames. Every cell has a frame.
    """
    order = np.argsort(cell, kind="stable")
    ends = np.cumsum(np.bincount(cell))
    return np.split(frames[order], ends[:-1])


def _means_of(
    readings: Callable[[np.ndarray], np.ndarray],
    frames_of_cell: list[np.ndarray],
    cells: pd.DataFrame,
) -> _Means:
    """Return means of readings over about equally many frames of each cell.

    Args:
        readings: see `quick_error`.
        frames_of_cell: usable frames of each cell.
        cells: `label` and `group` of each cell.
    """
    frames_of_mean = list[np.ndarray]()
    cell_of_mean = list[int]()
    most = max(1, MOST_FRAMES_READ // len(cells))
    for cell, frames in enumerate(frames_of_cell):
        spread = evenly(frames, most)
        means = -(-len(spread) // FRAMES_OF_MEAN)
        for first in range(means):
            frames_of_mean.append(spread[first::means])
            cell_of_mean.append(cell)
    used = np.concatenate(frames_of_mean)
    ends = np.cumsum([len(frames) for frames in frames_of_mean])
    of_mean = np.split(readings(used), ends[:-1])
    return _Means(
        values=np.stack([values.mean(axis=0, dtype=np.float64) for values in of_mean]),
        cell=np.array(cell_of_mean),
        label=cells["label"].to_numpy(),
        group=cells["group"].to_numpy(),
        frames=len(used),
    )


def _wrong_by_cell(means: _Means, labels: np.ndarray, *, nearest: bool) -> np.ndarray:
    """Return the share of wrong answers (C,) of each cell.

    Args:
        means: mean readings of the cells.
        labels: (C,), the object that each cell is taken for.
        nearest: see `quick_error`.
    """
    expected = labels[means.cell]
    answers = _answers(means.values, expected, means.group[means.cell], nearest=nearest)
    wrong = np.bincount(means.cell, answers != expected)
    return np.asarray(wrong / np.bincount(means.cell))


def _share_by_chance(error: float, means: _Means) -> float:
    """Return the share of random assignments of objects to groups whose error is as low.

    An object keeps its number of groups. If groups span objects, as sessions do, objects change
    places only within a group.

    Args:
        error: the error with the true objects.
        means: mean readings of the cells.
    """
    rng = stream(SPLIT_SEED, "permutations")
    block_of_cell = np.zeros_like(means.group)
    spans_objects = len(np.unique(means.group)) < len(means.group)
    if spans_objects:
        block_of_cell = means.group
    blocks = [np.flatnonzero(block_of_cell == block) for block in np.unique(block_of_cell)]
    as_low = 0
    for _ in range(PERMUTATIONS):
        objects = means.label.copy()
        for cells in blocks:
            objects[cells] = rng.permutation(objects[cells])
        as_low += _wrong_by_cell(means, objects, nearest=False).mean() <= error + ROUNDING
    return as_low / PERMUTATIONS


def _answers(
    means: np.ndarray, label: np.ndarray, group: np.ndarray, *, nearest: bool
) -> np.ndarray:
    """Return the objects (n,) that a classifier of other groups assigns to mean readings.

    Every object has two groups or more, so each mean is answered, see `complete_folds`.

    With `nearest` the answer is the object of the nearest mean of other groups. Otherwise it is the
    object whose mean ridge scores are nearest to the scores of the mean. The largest score does not
    serve. It would never name an object that reads between two others, for example because all
    sensors of an object share an offset. Hastie, Tibshirani and Friedman call this masking ("The
    elements of statistical learning", section 4.2).

    Args:
        means: (n, S), mean readings.
        label: (n,), object of each mean.
        group: (n,), group of each mean.
        nearest: see `quick_error`.
    """
    from sklearn.neighbors import KNeighborsClassifier
    from sklearn.preprocessing import StandardScaler
    from threadpoolctl import threadpool_limits

    answer = np.full(len(label), -1)
    # one thread, so that no choice depends on the number of threads
    with threadpool_limits(1), warnings.catch_warnings():
        # scikit-learn warns if many objects have two groups each
        warnings.filterwarnings("ignore", "The number of unique classes")
        for held_out in complete_folds(group, label, LEAK_FOLDS):
            training = ~held_out
            points = StandardScaler().fit(means[training]).transform(means)
            known = points[training]
            objects = label[training]
            if not nearest:
                points = _ridge_scores(points, label, training)
                objects = np.unique(label[training])
                of_object = [points[training & (label == name)] for name in objects]
                known = np.stack([scores.mean(axis=0) for scores in of_object])
            classifier = KNeighborsClassifier(1).fit(known, objects)
            answer[held_out] = classifier.predict(points[held_out])
    return answer


def _ridge_scores(points: np.ndarray, label: np.ndarray, training: np.ndarray) -> np.ndarray:
    """Return the scores (n, O) of a ridge regression for each object of the training set.

    Args:
        points: (n, S), standardised readings.
        label: (n,), object of each point.
        training: bool (n,), the points to fit.
    """
    from sklearn.linear_model import Ridge

    known = label[training]
    is_object = (known[:, None] == np.unique(known)).astype(np.float64)
    ridge = Ridge(RIDGE_PENALTY * points.shape[1]).fit(points[training], is_object)
    return np.asarray(ridge.predict(points)).reshape(len(points), -1)


def check_leak(
    recordings: Recordings, baseline: Baseline, states: HandStates, group: np.ndarray
) -> QuickError | None:
    """Return the error of recognising objects by open-hand frames.

    The baseline of the last frame of contact before it is subtracted from each open-hand frame. Its
    own baseline would not do: it is a mean over open-hand frames, so that drift would cancel. Only
    frames before the first contact of a recording have their own baseline subtracted. The empty
    hand is not an object here.

    Args:
        recordings: the table of raw counts.
        baseline: the baseline of its frames.
        states: the states of the hand in these frames.
        group: (T,), split group of each frame.

    Returns:
        The error; None unless two objects have open-hand frames in two groups each.
    """
    frame = pd.Series(np.arange(len(recordings)))
    recording = np.asarray(recordings.columns["recording"])
    last_contact = frame.where(states.contact).groupby(recording).ffill()
    before = last_contact.fillna(frame).to_numpy(int)

    def excess(index: np.ndarray) -> np.ndarray:
        mean = baseline.mean[baseline.of_frame[before[index]]]
        return np.asarray(states.counts[index] - mean[:, recordings.live])

    untouched = states.open & ~np.asarray(recordings.empty_hand)
    label = np.asarray(recordings.columns["object"])
    return quick_error(excess, untouched, label=label, group=group)


def leak_note(leak: QuickError, *, advised: bool) -> Note:
    """Return a leak check in one line; it is a warning with a remedy if the objects are recognised.

    Args:
        leak: the error without contact.
        advised: whether setting the baseline to `grasp` is a remedy.
    """
    text = (
        f"frames without contact predict the object with an error of {100 * leak.error:.1f} % "
        f"({100 * leak.low:.1f} to {100 * leak.high:.1f}), chance {100 * leak.chance:.1f} %; "
        f"{several(leak.frames, 'frame')} in {several(leak.groups, 'group')}"
    )
    if leak.objects_left_out:
        objects = several(leak.objects_left_out, "object")
        text += f"; {objects} left out, with such frames in a single group only"
    if not leak.beats_chance:
        return Note(text, topic=TOPIC)
    text += (
        ". A low error rate says little about touch then. Touches too light to count as contact "
        "look the same to this check. "
    )
    if not advised:
        text += "Hold out larger groups (split.by; in Python, groups)"
        return Note(text, "warning", TOPIC)
    text += "Set preprocess.baseline to grasp, or hold out larger groups (split.by; in Python, "
    text += "groups)"
    return Note(text, "warning", TOPIC, "preprocess.baseline", "grasp")
