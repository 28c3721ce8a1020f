"""The leak check: can the object be told from frames without contact? Then an error says little about touch."""

import time
import warnings
from dataclasses import asdict, dataclass

import numpy as np

from tactile_viewgcn.frames.baseline import Baseline
from tactile_viewgcn.frames.open_hand import OpenHand, frames_by_recording, of_empty_hand
from tactile_viewgcn.frames.split import TEST, fold_sides, split_groups
from tactile_viewgcn.intervals import proportion_interval
from tactile_viewgcn.tables.recordings import Recordings

MAX_FRAMES = 2000
FOLDS = 3
PENALTY = 0.01  # C of the logistic regression
MAX_STEPS = 15  # of its solver, fewer than it takes to converge
ROUNDING = 1e-9  # of a share


@dataclass(frozen=True)
class Leak:
    """How often a logistic regression takes the open hand beside one object for that beside another.

    Attributes:
        error: share of the held-out groups whose open-hand frames together are given to another object.
        low, high: its 95 % interval, which resamples groups.
        chance: error of always naming the object with the most groups.
        groups, frames: numbers that were used.
        seconds: that the check took.
    """

    error: float
    low: float
    high: float
    chance: float
    groups: int
    frames: int
    seconds: float

    @property
    def found(self) -> bool:
        """Whether the object is told better than by chance."""
        return self.high < self.chance - ROUNDING

    def counts(self) -> dict[str, float]:
        """The numbers by the names that they are logged under."""
        return {f"leak.{name}": value for name, value in asdict(self).items()}


def check_leak(
    recordings: Recordings, baseline: Baseline, hand: OpenHand, by: str, rng: np.random.Generator
) -> Leak | None:
    """Tell the objects apart by at most 2,000 open-hand frames; None without open-hand frames that can be held out.

    A third of the groups of `by`, as in `split.by`, is held out at a time. From a frame the baseline is subtracted
    that the last frame of contact before it has, as from a grasp: a baseline of the open hand itself would hide its own
    drift. The empty hand is no object here, and an object needs two groups.

    Raises:
        UserError: groups that the recordings do not have.
    """
    start, label = time.perf_counter(), recordings.columns["object"]
    group = np.arange(len(label)) if by == "frame" else split_groups(recordings.columns, by)
    index = _frames_to_use(hand.open & ~of_empty_hand(recordings), label, group, rng)
    if len(np.unique(label[index])) < 2:
        return None
    of_frame = baseline.of_frame[_last_contact(recordings, hand.contact)[index]]
    excess = hand.counts[index] - baseline.mean[of_frame][:, recordings.live]
    return _told(excess, label[index], group[index], by == "session", rng, start)


def check_first_frames(recordings: Recordings, hand: OpenHand, rng: np.random.Generator) -> Leak | None:
    """Tell the objects apart by the first frame of each recording alone; None where none can be held out.

    From a frame the mean of the first frames of its session is subtracted. The empty hand is no object here, and an
    object needs two recordings.
    """
    start, label, session = time.perf_counter(), recordings.columns["object"], recordings.columns["session"]
    first = np.zeros(len(label), dtype=bool)
    first[[index[0] for index in frames_by_recording(recordings)]] = True
    group = recordings.columns["recording"].astype(np.int64)
    index = _frames_to_use(first & ~of_empty_hand(recordings), label, group, rng)
    if len(np.unique(label[index])) < 2:
        return None
    counts = hand.counts[index].astype(np.float64)
    for number in np.unique(session[index]):
        counts[session[index] == number] -= counts[session[index] == number].mean(axis=0)
    return _told(counts, label[index], group[index], False, rng, start)


def _told(
    excess: np.ndarray, label: np.ndarray, group: np.ndarray, across: bool, rng: np.random.Generator, start: float
) -> Leak:
    """How often frames (n, S) tell their object; `start` is when the check began."""
    truth, of_group, answer = _answers(_standardised(excess), label, group, across)
    wrong = (answer != truth).astype(float)
    low, high = proportion_interval(wrong, of_group, rng) or (0.0, 1.0)
    chance = 1 - np.bincount(truth).max() / len(truth)
    seconds = time.perf_counter() - start
    return Leak(float(wrong.mean()), low, high, float(chance), len(np.unique(of_group)), len(excess), seconds)


def describe(leak: Leak | None, baseline: str, *, all_contact: bool = False) -> str:
    """A leak check in one line, and a warning where the object is told; `baseline` is `preprocess.baseline`."""
    if all_contact:
        return "leak check: even the quietest frames are contact: not checked"
    if leak is None:
        return "leak check: no open-hand frames of two objects, each in two groups: not checked"
    line = (
        f"leak check: the object is told from frames without contact with an error of {100 * leak.error:.1f} % "
        f"({100 * leak.low:.1f} to {100 * leak.high:.1f}), chance {100 * leak.chance:.1f} %; {leak.frames:,} frames in "
        f"{leak.groups} groups, {leak.seconds:.1f} s"
    )
    if not leak.found:
        return line
    remedy = "set preprocess.baseline to grasp, or choose" if baseline != "grasp" else "choose"
    return f"{line}\n  warning: better than by chance, so that errors say less about touch: {remedy} another split.by"


def _frames_to_use(usable: np.ndarray, label: np.ndarray, group: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rising indices of at most 2,000 usable frames of objects with two groups or more, as even as can be over groups.

    Args:
        usable: bool (T,); label, group: (T,).
    """
    index = rng.permutation(np.flatnonzero(usable))
    cells, cell = _cells(label[index], group[index])
    several = np.bincount(cells[:, 0])[label[index]] > 1
    index, cell = index[several], cell[several]
    order = np.argsort(cell, kind="stable")
    rank = np.empty(len(index), dtype=np.int64)  # of a frame in its cell
    rank[order] = np.arange(len(index)) - np.searchsorted(cell[order], cell[order])
    return np.sort(index[np.argsort(rank, kind="stable")[:MAX_FRAMES]])


def _cells(label: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (C, 2) of an object and a group that frames (n,) have, and the pair (n,) of each."""
    cells, cell = np.unique(np.stack([label, group], axis=1), axis=0, return_inverse=True)
    return cells, cell.ravel()


def _last_contact(recordings: Recordings, contact: np.ndarray) -> np.ndarray:
    """Index (T,) of the last frame of contact before each frame in its recording; its own where there is none."""
    last = np.arange(len(contact))
    for index in frames_by_recording(recordings):
        before = np.maximum.accumulate(np.where(contact[index], np.arange(len(index)), -1))
        last[index] = np.where(before < 0, index, index[before])
    return last


def _standardised(excess: np.ndarray) -> np.ndarray:
    """The same as float32 (n, S), each sensor with mean 0 and standard deviation 1, so that it has no unit."""
    excess = excess - excess.mean(axis=0)
    std = excess.std(axis=0)
    return (excess / np.where(std > 0, std, 1)).astype(np.float32)


def _answers(
    inputs: np.ndarray, label: np.ndarray, group: np.ndarray, across: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Object, group and answer (C,) for each object's frames in each group, which were held out.

    An answer is the object with the largest mean log-probability over the frames.

    Args:
        inputs: (n, S); label, group: (n,).
        across: groups span objects, as sessions do.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import LogisticRegression

    cells, cell = _cells(label, group)
    answer = np.full(len(cells), -1)
    for fold in range(FOLDS):
        test = fold_sides(group, label, folds=FOLDS, fold=fold, across=across) == TEST
        if not test.any() or len(np.unique(label[~test])) < 2:
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            model = LogisticRegression(C=PENALTY, max_iter=MAX_STEPS).fit(inputs[~test], label[~test])
        logits = model.decision_function(inputs[test])
        logits = np.stack([-logits, logits], axis=1) if logits.ndim == 1 else logits
        sums = np.zeros((len(cells), logits.shape[1]))
        np.add.at(sums, cell[test], logits)
        answer[cell[test]] = model.classes_[sums.argmax(axis=1)][cell[test]]
    return cells[:, 0], cells[:, 1], answer
