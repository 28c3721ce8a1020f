"""A quick classifier of what sensors read on average, and its error on groups that it was not fitted to."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.frames.split import SPLIT_SEED, fold_sides, spans_classes
from tactile_viewgcn.intervals import proportion_interval
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import TEST

MAX_FRAMES = 2000
FRAMES = 8  # of a mean, at most: as many as the paper's views
FOLDS = 3
PENALTY = 2.0  # of ridge regression, for each sensor
ROUNDING = 1e-9  # of a share


@dataclass(frozen=True)
class QuickError:
    """How often means of eight frames are taken for another object's.

    Attributes:
        cells: (C, 2) object and group.
        wrong: (C,) share of the means of each that are.
        low, high: 95 % interval of the error, which resamples groups.
        chance: error of always naming the object with the most groups.
        frames: number that was used.
        seconds: that it took.
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
    def tells_object(self) -> bool:
        """Whether the object is told better than by chance."""
        return self.high < self.chance - ROUNDING

    @property
    def standard_error(self) -> float:
        """Of the error, over groups; infinite with one group."""
        return self._spread(self.wrong)

    def more_than(self, other: "QuickError") -> tuple[float, float]:
        """By how much this error is above another of the same cells, and the standard error of that over groups."""
        more = self.wrong - other.wrong
        return float(more.mean()), self._spread(more)

    def _spread(self, values: np.ndarray) -> float:
        """Standard error of the mean of values (C,), whose groups are drawn."""
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
    """Tell the objects apart by at most 2,000 usable frames bool (T,); None where no two objects have two groups.

    Of an object's frames in a group, those of a mean are spread over all of them. A third of the groups is held out at
    a time; those that span objects, as sessions do, for all objects at once.

    Args:
        purpose: names the random numbers; those of one purpose are always the same.
        readings: gives (n, S) of frames (n,).
        label, group: (T,) object and group of each frame.
    """
    start, rng = time.perf_counter(), stream(SPLIT_SEED, purpose)
    index = _frames_to_use(usable, label, group, rng)
    if len(np.unique(label[index])) < 2:
        return None
    cells, cell, sizes = _cells(label[index], group[index])
    rows = -(-sizes // FRAMES)
    row = (np.cumsum(rows) - rows)[cell] + _places(cell) % rows[cell]
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
    """Rising indices of at most 2,000 usable frames of objects with two groups, as even as can be over groups."""
    index = rng.permutation(np.flatnonzero(usable))
    cells, cell, _ = _cells(label[index], group[index])
    has_two = np.bincount(cells[:, 0])[label[index]] > 1
    return np.sort(index[has_two][np.argsort(_places(cell)[has_two], kind="stable")[:MAX_FRAMES]])


def _cells(label: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs (C, 2) of an object and a group that frames (n,) have, the pair (n,) of each, and their numbers (C,)."""
    pairs = np.stack([label, group], axis=1).astype(np.int64)
    cells, cell, sizes = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
    return cells, cell.ravel(), sizes


def _places(cell: np.ndarray) -> np.ndarray:
    """Place (n,) of each frame among those of its cell (n,)."""
    order, places = np.argsort(cell, kind="stable"), np.empty_like(cell)
    places[order] = np.arange(len(cell)) - np.searchsorted(cell[order], cell[order])
    return places


def _answers(means: np.ndarray, label: np.ndarray, group: np.ndarray) -> np.ndarray:
    """The object (n,) that mean frames (n, S) are given to by ridge regression on other groups."""
    from sklearn.linear_model import RidgeClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    from threadpoolctl import threadpool_limits

    answer, across = np.full(len(label), -1), spans_classes(group, label)
    for fold in range(FOLDS):
        test = fold_sides(group, label, folds=FOLDS, fold=fold, across=across) == TEST
        if test.any() and len(np.unique(label[~test])) > 1:
            model = make_pipeline(StandardScaler(), RidgeClassifier(PENALTY * means.shape[1]))
            with threadpool_limits(1):  # so that no choice hangs on their number; more are no faster here
                answer[test] = model.fit(means[~test], label[~test]).predict(means[test])
    return answer
