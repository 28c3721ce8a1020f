"""The leak check: can the object be told from frames without contact? Then an error says little about touch."""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import Baseline, empty_hand_baseline, of_empty_hand
from tactile_viewgcn.frames.grasp_baseline import grasp_baseline
from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.frames.open_hand import OpenHand, frames_by_recording
from tactile_viewgcn.frames.split import SPLIT_SEED, fold_sides, split_groups
from tactile_viewgcn.intervals import proportion_interval
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.params import Split
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import TEST
from tactile_viewgcn.tables.recordings import Recordings

MAX_FRAMES = 2000
FOLDS = 3
ALPHA = 2000.0  # ridge penalty; from 1,000 to 10,000 the STAG files and the simulated recordings are judged alike
ROUNDING = 1e-9  # of a share


@dataclass(frozen=True)
class Leak:
    """How often a ridge classifier takes the open hand beside one object for that beside another.

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
    def tells_object(self) -> bool:
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
    group = np.arange(len(hand.open)) if by == "frame" else split_groups(recordings.columns, by)

    def excess(index: np.ndarray) -> np.ndarray:
        of_frame = baseline.of_frame[_last_contact(recordings, hand.contact)[index]]
        return hand.counts[index] - baseline.mean[of_frame][:, recordings.live]

    return _leak(recordings, hand.open, group, excess, by == "session", rng)


def check_first_frames(recordings: Recordings, hand: OpenHand, rng: np.random.Generator) -> Leak | None:
    """Tell the objects apart by the first frame of each recording alone; None where none can be held out.

    From a frame the mean of the first frames of its session is subtracted. The empty hand is no object here, and an
    object needs two recordings.
    """
    first = np.zeros(len(hand.open), dtype=bool)
    first[[index[0] for index in frames_by_recording(recordings)]] = True

    def excess(index: np.ndarray) -> np.ndarray:
        counts, session = hand.counts[index].astype(np.float64), recordings.columns["session"][index]
        for number in np.unique(session):
            counts[session == number] -= counts[session == number].mean(axis=0)
        return counts

    return _leak(recordings, first, recordings.columns["recording"].astype(np.int64), excess, False, rng)


def leaks_of_baselines(recordings: Recordings, inspection: Inspection, *kinds: str) -> dict[str, Leak]:
    """The leak check with each of these baselines that the recordings allow; empty where all frames are contact."""
    leaks: dict[str, Leak] = {}
    for kind in () if inspection.all_contact else kinds:
        with suppress(UserError):  # no such baseline
            if kind == "grasp":
                sensors, sigmas = inspection.contact_sensors, inspection.contact_sigmas
                baseline = grasp_baseline(recordings, sensors=sensors, sigmas=sigmas)
            else:
                baseline = empty_hand_baseline(recordings)
            leak = check_leak(recordings, baseline, inspection.hand, _groups_by(inspection), stream(0, "leak"))
            leaks |= {kind: leak} if leak else {}
    return leaks


def deciding_leaks(recordings: Recordings, inspection: Inspection) -> dict[str, Leak]:
    """The leak checks that decide between the baselines empty_hand and grasp; often none."""
    if not inspection.has_empty_hand or inspection.has_published_split or inspection.drifts_from_empty_hand:
        return {}
    leaks = leaks_of_baselines(recordings, inspection, "empty_hand")
    if "empty_hand" in leaks and leaks["empty_hand"].tells_object:
        leaks |= leaks_of_baselines(recordings, inspection, "grasp")
    return leaks


def leak_of_split(
    recordings: Recordings, inspection: Inspection, leaks: dict[str, Leak], baseline: Baseline, kind: str, split: Split
) -> tuple[Leak | None, list[Note]]:
    """The leak check with the baseline of a `kind` that was taken and the groups of the split, and notes on it.

    None where all frames are contact, and as `check_leak` says. One of `leaks`, which decided on the baseline, is taken
    where it is the same check.
    """
    by = "recording" if split.by == "source" else split.by  # whose groups are recordings
    if inspection.all_contact:
        return None, [Note("even the quietest frames are contact: not checked", topic="leak check")]
    if kind in leaks and by == _groups_by(inspection):
        leak: Leak | None = leaks[kind]
    else:
        leak = check_leak(recordings, baseline, inspection.hand, split.by, stream(SPLIT_SEED, "leak"))
    return leak, leak_notes(leak, kind)


def leak_notes(leak: Leak | None, kind: str) -> list[Note]:
    """A leak check in one line, and a warning where the object is told; `kind` is `preprocess.baseline`."""
    if leak is None:
        return [Note("no open-hand frames of two objects, each in two groups: not checked", topic="leak check")]
    text = (
        f"the object is told from frames without contact with an error of {100 * leak.error:.1f} % "
        f"({100 * leak.low:.1f} to {100 * leak.high:.1f}), chance {100 * leak.chance:.1f} %; "
        f"{several(leak.frames, 'frame')} in {several(leak.groups, 'group')}, {leak.seconds:.1f} s"
    )
    notes = [Note(text, topic="leak check")]
    if leak.tells_object:
        text = "the object is told without contact better than by chance, so that errors say less about touch"
        if kind == "grasp":
            notes.append(Note(f"{text}: choose another split.by", "warning", "leak check"))
        else:
            text += ": set preprocess.baseline to grasp, or choose another split.by"
            notes.append(Note(text, "warning", "leak check", "preprocess.baseline", "grasp"))
    return notes


def _groups_by(inspection: Inspection) -> str:
    """`split.by` of the checks that decide: recordings, or grasps where no object has two recordings."""
    groups = inspection.groups
    return "grasp" if (groups["recording"] < 2).all() and "grasp" in groups else "recording"


def _leak(
    recordings: Recordings,
    usable: np.ndarray,
    group: np.ndarray,
    excess: Callable[[np.ndarray], np.ndarray],
    across: bool,
    rng: np.random.Generator,
) -> Leak | None:
    """How often usable frames bool (T,), of groups (T,), tell their object; None where nothing can be held out.

    `excess` gives counts (n, S) above a baseline of frames (n,); with `across` groups span objects, as sessions do.
    """
    start, label = time.perf_counter(), recordings.columns["object"]
    index = _frames_to_use(usable & ~of_empty_hand(recordings), label, group, rng)
    if len(np.unique(label[index])) < 2:
        return None
    cells, answer = _answers(excess(index), label[index], group[index], across)
    wrong = (answer != cells[:, 0]).astype(float)
    low, high = proportion_interval(wrong, cells[:, 1], rng) or (0.0, 1.0)
    chance = 1 - np.bincount(cells[:, 0]).max() / len(cells)
    seconds = time.perf_counter() - start
    return Leak(float(wrong.mean()), low, high, float(chance), len(np.unique(cells[:, 1])), len(index), seconds)


def _frames_to_use(usable: np.ndarray, label: np.ndarray, group: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rising indices of at most 2,000 usable frames of objects with two groups, as even as can be over groups."""
    index = rng.permutation(np.flatnonzero(usable))
    cells, cell = _cells(label[index], group[index])
    has_two = np.bincount(cells[:, 0])[label[index]] > 1
    index, cell = index[has_two], cell[has_two]
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


def _answers(excess: np.ndarray, label: np.ndarray, group: np.ndarray, across: bool) -> tuple[np.ndarray, np.ndarray]:
    """Object and group (C, 2) of each object's frames in each group, and the object (C,) they are given to, held out.

    That is the one with the largest sum of decision values over the frames (n, S).
    """
    from sklearn.linear_model import RidgeClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    cells, cell = _cells(label, group)
    answer = np.full(len(cells), -1)
    for fold in range(FOLDS):
        test = fold_sides(group, label, folds=FOLDS, fold=fold, across=across) == TEST
        if not test.any() or len(np.unique(label[~test])) < 2:
            continue
        model = make_pipeline(StandardScaler(), RidgeClassifier(ALPHA)).fit(excess[~test], label[~test])
        values = model.decision_function(excess[test])
        values = np.stack([-values, values], axis=1) if values.ndim == 1 else values
        sums = np.zeros((len(cells), values.shape[1]))
        np.add.at(sums, cell[test], values)
        answer[cell[test]] = model.classes_[sums.argmax(axis=1)][cell[test]]
    return cells, answer
