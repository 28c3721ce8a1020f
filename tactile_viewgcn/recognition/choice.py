"""The choice of a recogniser on the sensors, and its calibration, by cross-validation on the training recordings.

A candidate is one member of `sensors` or several. Nothing is pretrained for them, so that a group can be left out of
all that is fitted to labels.
"""

import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch

from tactile_viewgcn.frames.split import fold_sides, spans_classes
from tactile_viewgcn.messages import Note
from tactile_viewgcn.recognition.calibration import fit_temperature, together_temperatures
from tactile_viewgcn.recognition.sequential import Calibration
from tactile_viewgcn.sensors.estimators import Estimator
from tactile_viewgcn.sensors.examples import FRAME, WHOLE, Examples, added, for_sets
from tactile_viewgcn.sensors.representation import OF_FRAMES
from tactile_viewgcn.tables.frames import TEST

#: a later candidate is taken only if all earlier ones err more by more than a standard error
ARRAY: list[list[str]] = [["kernel", "pooled_kernel"], ["svm"], ["convolutions"]]
CHANNELS: list[list[str]] = [
    ["trees", "svm", "convolutions"],
    ["trees", "svm"],
    ["trees"],
    ["svm"],
    ["convolutions"],
]
FOLDS = 5


class Candidate(NamedTuple):
    """A candidate and its errors on groups that it was not fitted to.

    Attributes:
        members: a value of `model.members`.
        wrong: (G,) share of wrong answers to the recordings of each group.
        seconds: of all its fits; milliseconds: of one answer to a recording.
    """

    members: list[str]
    wrong: np.ndarray
    seconds: float
    milliseconds: float


class LeftOut:
    """Answers to training recordings by estimators that were fitted to other groups, a fifth left out at a time.

    A class whose groups would all be left out stays in the training.

    Args:
        groups: (R,) split group of each of the examples' recordings.

    Attributes:
        answered: bool (R,).
        seconds, milliseconds: of a member's fits to whole recordings, and of one answer.
    """

    def __init__(self, examples: Examples, groups: np.ndarray, seed: int):
        import sklearn.ensemble  # here, so that the seconds of a fit include no import
        import sklearn.linear_model
        import sklearn.svm  # noqa: F401

        self.examples, self.groups, self._seed = examples, groups, seed
        self._folds, label, across = list[np.ndarray](), examples.labels, spans_classes(groups, examples.labels)
        for fold in range(FOLDS):
            left = fold_sides(groups, label, folds=FOLDS, fold=fold, across=across) == TEST
            left &= np.isin(label, label[~left])
            if left.any():
                self._folds.append(left)
        self.answered = np.any(self._folds, axis=0) if self._folds else np.zeros(len(groups), dtype=bool)
        self._shares: dict[tuple[str, int], np.ndarray] = {}
        self._estimators: dict[str, list[Estimator]] = {}
        self.seconds, self.milliseconds = dict.fromkeys(examples.members, 0.0), dict.fromkeys(examples.members, 0.0)

    def _answers(self, member: str, size: int) -> np.ndarray:
        """Probabilities (n, classes) of the view sets of a size, or of the recordings."""
        if member == OF_FRAMES and size != FRAME:
            return self.examples.averaged(self._answers(member, FRAME), size)
        if (member, size) not in self._shares:
            for left in self._folds:
                begin = time.perf_counter()
                estimator = self.examples.fit(member, size, self._seed, ~left)
                if size == (FRAME if member == OF_FRAMES else WHOLE):
                    self.seconds[member] += time.perf_counter() - begin
                    self.milliseconds[member] = self.examples.milliseconds(member, estimator)
                if size == WHOLE:
                    self._estimators.setdefault(member, []).append(estimator)
                shares = self.examples.answers(member, size, estimator, left)
                kept = self._shares.setdefault((member, size), shares)
                kept[...] = np.where(np.isfinite(shares), shares, kept)
        return self._shares[member, size]

    def estimators(self, member: str) -> Iterator[tuple[np.ndarray, Estimator]]:
        """Pairs of the recordings that were left out, bool (R,), and the member's estimator for whole recordings."""
        self._answers(member, WHOLE)
        return zip(self._folds, self._estimators[member], strict=True)

    def logits(self, members: list[str], size: int) -> tuple[np.ndarray, np.ndarray]:
        """Logits (n, classes) of recordings or view sets that were left out, and the recording (n,) of each."""
        of = self.examples.recording_of(size)
        rows = self.answered[of]
        return added([self._answers(name, size)[rows] for name in members]), of[rows]

    def wrong(self, members: list[str]) -> np.ndarray:
        """Share of wrong answers (G,) to the recordings of each group that was left out."""
        logits, of = self.logits(members, WHOLE)
        place = np.unique(self.groups[of], return_inverse=True)[1]
        return np.bincount(place, logits.argmax(axis=1) != self.examples.labels[of]) / np.bincount(place)

    def calibration(self, members: list[str], views: int) -> Calibration | None:
        """Temperatures of a candidate; None where nothing was left out."""
        if not self.answered.any():
            return None
        labels, count, temperature, by_frames = (
            torch.from_numpy(self.examples.labels),
            int(self.answered.sum()),
            1.0,
            [],
        )
        for size in range(1, views + 1):
            if size in self.examples.sets:
                logits, of = self.logits(for_sets(members), size)
                temperature = fit_temperature(torch.from_numpy(logits), labels[of], count)
            by_frames.append(temperature)
        logits, of = self.logits(members, WHOLE)
        return Calibration(by_frames, together_temperatures(torch.from_numpy(logits), labels[of]))


def choose(rows: list[Candidate]) -> Candidate:
    """The first row whose error exceeds the lowest by at most one standard error of the difference over groups."""
    best = min(rows, key=lambda row: row.wrong.mean())
    within = (row for row in rows if (row.wrong - best.wrong).mean() <= standard_error(row, best))
    return next(within, best)


def standard_error(row: Candidate, best: Candidate) -> float:
    """The standard error of the difference between two candidates' errors, over groups; 0 of one group."""
    more = row.wrong - best.wrong
    return float(more.std(ddof=1) / len(more) ** 0.5) if len(more) > 1 else 0.0


def choose_members(left: LeftOut, candidates: list[list[str]], groups: int) -> tuple[list[str], list[Note]]:
    """The members, and notes: the choice, and a table of the candidates up to the first that errs nowhere.

    The table begins with the chosen one; the others follow by their errors. A note of the table is a line that fits a
    terminal of 80 columns: the error, the standard error of its difference from the lowest, and the costs. Its value
    has the same facts for programs.

    Args:
        groups: number of all training groups.
    """
    if not left.answered.any():
        text = "no object has two groups to train on, so that none can be left out: taken without a comparison"
        return candidates[0], [_choice(candidates[0], text)]
    rows = []
    for members in candidates:
        if rows and not rows[-1].wrong.any():
            break
        wrong, costs = left.wrong(members), (left.seconds, left.milliseconds)
        rows.append(Candidate(members, wrong, *(sum(of[name] for name in members) for of in costs)))
    best = choose(rows)
    count = len(best.wrong)
    compared = f"{count:,} of {groups:,}" if count < groups else f"{count:,}"
    text = (
        f"the first of {len(rows)} candidates whose error is within a standard error of the lowest; compared on "
        f"{compared} training groups, each left out of the fits that answer it"
    )
    if len(rows) == 1 < len(candidates):
        text = (
            f"errs nowhere on {compared} training groups, each left out of the fits that answer it: no other is tried"
        )
    columns = f"{'err %':>5} {'±':>5} {'fit s':>6} {'ms':>5}"
    notes = [_choice(best.members, text), Note(f"{columns}   of whole recordings; * taken", topic="candidates")]
    lowest = min(rows, key=lambda row: row.wrong.mean())
    for row in sorted(rows, key=lambda row: (row is not best, row.wrong.mean())):
        error, above = float(row.wrong.mean()), standard_error(row, lowest)
        text = f"{100 * error:5.1f} {100 * above:5.1f} {row.seconds:6.1f} {row.milliseconds:5.1f}"
        text += f" {'*' if row is best else ' '} {'+'.join(row.members)}"
        value = {"members": row.members, "error": error, "standard_error": above, "taken": row is best}
        value |= {"seconds": row.seconds, "milliseconds": row.milliseconds}
        notes.append(Note(text, topic="candidates", key="model.members", value=value))
    return best.members, notes


def _choice(members: list[str], reason: str) -> Note:
    return Note(reason, "choice", "recogniser", "model.members", members)
