"""Answers to training recordings that were left out of the fits: what the choice and the calibration go by."""

import time

import numpy as np
import torch

from tactile_viewgcn.frames.split import fold_sides, spans_classes
from tactile_viewgcn.recognition.calibration import fit_temperature, together_temperatures
from tactile_viewgcn.recognition.sequential import Calibration
from tactile_viewgcn.sensors.examples import FRAME, WHOLE, Examples, added, for_sets
from tactile_viewgcn.sensors.representation import OF_FRAMES
from tactile_viewgcn.tables.frames import TEST

FOLDS = 5


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
        self.seconds, self.milliseconds = dict.fromkeys(examples.members, 0.0), dict.fromkeys(examples.members, 0.0)

    def _answers(self, member: str, size: int) -> np.ndarray:
        """Probabilities (n, classes) of the view sets of a size, or of the recordings."""
        if member == OF_FRAMES and size != FRAME:
            return self.examples.averaged(self._answers(member, FRAME), size)
        if (member, size) not in self._shares:
            self.examples.points(member, size)  # which are computed once, and are no part of a fit
            for left in self._folds:
                begin = time.perf_counter()
                estimator = self.examples.fit(member, size, self._seed, ~left)
                if size == (FRAME if member == OF_FRAMES else WHOLE):
                    self.seconds[member] += time.perf_counter() - begin
                    self.milliseconds[member] = self.examples.milliseconds(member, estimator)
                shares = self.examples.answers(member, size, estimator, left)
                kept = self._shares.setdefault((member, size), shares)
                kept[...] = np.where(np.isfinite(shares), shares, kept)
        return self._shares[member, size]

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
