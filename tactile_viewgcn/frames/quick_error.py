"""A quick classifier of mean readings, and its error on groups that it was not fitted to."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.frames.split import SPLIT_SEED, fold_sides, spans_classes
from tactile_viewgcn.intervals import proportion_interval
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import TEST

MAX_FRAMES = 2000
FRAMES = 8  # most frames in a mean: as many as the paper's views
FOLDS = 3
PENALTY = 2.0  # of ridge regression, for each sensor
ROUNDING = 1e-9  # of a share


@dataclass(frozen=True)
class QuickError:
    """How often the mean of eight frames is taken for a different object's.

    Attributes:
        cells: (C, 2) pairs of an object and a group of it.
        wrong: (C,) share of the wrong answers in each cell.
        low, high: 95 % interval of the error, which resamples groups.
        chance: error of always answering the object with the most groups.
        frames: number of frames used.
        seconds: time taken.
    """

    cells: np.ndarray
    wrong: np.ndarray
    low: float
    high: float
    chance: float
    frames: int
    seconds: float

    @property
    def error(self) -> float:
        """Mean over the cells."""
        return float(self.wrong.mean())

    @property
    def groups(self) -> int:
        """Number of groups."""
        return len(np.unique(self.cells[:, 1]))

    @property
    def beats_chance(self) -> bool:
        """Whether the whole interval lies below chance: the readings predict the object."""
        return self.high < self.chance - ROUNDING

    @property
    def standard_error(self) -> float:
        """Standard error of the error over groups; infinite with one group."""
        return self._spread(self.wrong)

    def more_than(self, other: "QuickError") -> tuple[float, float]:
        """Mean difference to another error of the same cells, and its standard error over groups."""
        more = self.wrong - other.wrong
        return float(more.mean()), self._spread(more)

    def _spread(self, values: np.ndarray) -> float:
        """Standard error of the mean of values (C,), if groups are drawn."""
        _, group, sizes = np.unique(self.cells[:, 1], return_inverse=True, return_counts=True)
        of_group = np.bincount(group.ravel(), values - values.mean())
        count = len(sizes)
        return float(np.sqrt((of_group**2).sum() * count / (count - 1)) / len(values)) if count > 1 else np.inf


def quick_error(
    purpose: str,
    readings: Callable[[np.ndarray], np.ndarray],
    usable: np.ndarray,
    label: np.ndarray,
    group: np.ndarray,
) -> QuickError | None:
    """Error of recognising the objects in at most 2,000 frames; None unless two objects have two groups each.

    Each mean is over frames that are spread over an object's frames in a group. A third of the groups is held out at a
    time: of each object by itself, or of all objects at once where groups span objects, as sessions do.

    Args:
        purpose: names the stream of random numbers; equal purposes draw equal numbers.
        readings: function from frames (n,) to their readings (n, S).
        usable: bool (T,) frames to draw from.
        label, group: (T,) object and group of each frame.
    """
    start, rng = time.perf_counter(), stream(SPLIT_SEED, purpose)
    index = _frames_to_use(usable, label, group, rng)
    if len(np.unique(label[index])) < 2:
        return None
    cells, cell, sizes = _cells(label[index], group[index])
    rows = -(-sizes // FRAMES)
    row = (np.cumsum(rows) - rows)[cell] + _rank(cell) % rows[cell]
    frames = np.bincount(row)
    values = np.asarray(readings(index), dtype=np.float64)[np.argsort(row, kind="stable")]
    means = np.add.reduceat(values, np.cumsum(frames) - frames, axis=0) / frames[:, None]
    of_cell = np.repeat(np.arange(len(cells)), rows)
    label_of, group_of = cells[of_cell].T
    wrong = np.bincount(of_cell, _answers(means, label_of, group_of) != label_of) / rows
    low, high = proportion_interval(wrong, cells[:, 1], rng) or (0.0, 1.0)
    chance = 1 - np.bincount(cells[:, 0]).max() / len(cells)
    return QuickError(cells, wrong, low, high, float(chance), len(index), time.perf_counter() - start)


def _frames_to_use(usable: np.ndarray, label: np.ndarray, group: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rising indices of at most 2,000 usable frames of objects with two groups, as even over groups as possible."""
    index = rng.permutation(np.flatnonzero(usable))
    cells, cell, _ = _cells(label[index], group[index])
    has_two = np.bincount(cells[:, 0])[label[index]] > 1
    return np.sort(index[has_two][np.argsort(_rank(cell)[has_two], kind="stable")[:MAX_FRAMES]])


def _cells(label: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distinct pairs (C, 2) of object and group of frames (n,), the index (n,) of each one's pair, and counts (C,)."""
    pairs = np.stack([label, group], axis=1).astype(np.int64)
    cells, cell, sizes = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
    return cells, cell.ravel(), sizes


def _rank(cell: np.ndarray) -> np.ndarray:
    """Rank (n,) of each frame among those of its cell (n,), from 0."""
    order, rank = np.argsort(cell, kind="stable"), np.empty_like(cell)
    rank[order] = np.arange(len(cell)) - np.searchsorted(cell[order], cell[order])
    return rank


def _answers(means: np.ndarray, label: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Objects (n,) that ridge regression on other groups assigns to mean readings (n, S); -1 if none was fitted."""
    from sklearn.linear_model import RidgeClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    from threadpoolctl import threadpool_limits

    answer, across = np.full(len(label), -1), spans_classes(group, label)
    for fold in range(FOLDS):
        test = fold_sides(group, label, folds=FOLDS, fold=fold, across=across) == TEST
        if test.any() and len(np.unique(label[~test])) > 1:
            model = make_pipeline(StandardScaler(), RidgeClassifier(PENALTY * means.shape[1]))
            with threadpool_limits(1):  # so that no choice depends on their number; more are no faster here
                answer[test] = model.fit(means[~test], label[~test]).predict(means[test])
    return answer
