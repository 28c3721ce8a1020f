"""The choice of a classifier on the sensors, and its calibration, by recordings that are left out of its fits.

A candidate is one member of `sensors` or several. Nothing is pretrained for them, so that a group can be left out of
all that is fitted to labels.
"""

import time

import numpy as np

from tactile_viewgcn.frames.folds import left_out
from tactile_viewgcn.messages import Note, several
from tactile_viewgcn.recognition.calibration import fit_temperature
from tactile_viewgcn.sensors.estimators import added, probabilities
from tactile_viewgcn.sensors.examples import Examples

#: a later candidate is taken only if all earlier ones err more by more than a standard error
ARRAY: list[list[str]] = [["kernel", "pooled_kernel"], ["svm"], ["convolutions"]]
CHANNELS: list[list[str]] = [["trees", "svm", "convolutions"], ["convolutions"]]
FOLDS = 5


class LeftOut:
    """Answers to training recordings by estimators that were fitted to other groups; a fifth is left out at a time.

    If a fold would remove a class from the training, that class's recordings are not left out.

    Args:
        groups: (R,) split group of each of the examples' recordings.

    Attributes:
        answered: bool (R,).
        seconds: of each member's fits to recordings.
    """

    def __init__(self, examples: Examples, groups: np.ndarray, seed: int):
        self.examples, self.groups, self._seed = examples, groups, seed
        self._folds = left_out(groups, examples.labels, FOLDS)
        self.answered = np.any(self._folds, axis=0) if self._folds else np.zeros(len(groups), dtype=bool)
        self.seconds: dict[str, float] = {}
        self._shares: dict[str, np.ndarray] = {}

    def _of_recordings(self, member: str) -> np.ndarray:
        """Probabilities (R, classes), means over a recording's points; 0 of recordings that were never left out."""
        if member not in self._shares:
            examples, (points, recording) = self.examples, self.examples.of_recordings(member)
            begin = time.perf_counter()
            shares, label = np.zeros((len(points), examples.classes), dtype=np.float32), examples.labels[recording]
            for rows in (left[recording] for left in self._folds):
                estimator = examples.representation.estimator(member, quick=True)
                estimator.fit(points[~rows], label[~rows], self._seed)
                shares[rows] = probabilities(estimator, points[rows], examples.classes)
            means = [shares[recording == each].mean(axis=0) for each in range(len(self.groups))]
            self._shares[member] = np.stack(means)
            self.seconds[member] = time.perf_counter() - begin
        return self._shares[member]

    def logits(self, members: list[str]) -> np.ndarray:
        """Logits (n, classes) of the recordings that were left out."""
        return added([self._of_recordings(name)[self.answered] for name in members])

    def wrong(self, members: list[str]) -> np.ndarray:
        """Share of wrong answers (G,) to the recordings of each group that was left out."""
        place = np.unique(self.groups[self.answered], return_inverse=True)[1]
        wrong = self.logits(members).argmax(axis=1) != self.examples.labels[self.answered]
        return np.bincount(place, wrong) / np.bincount(place)

    def temperature(self, members: list[str]) -> float | None:
        """The temperature of a candidate, see `calibration`; None where nothing was left out."""
        if not self.answered.any():
            return None
        return fit_temperature(self.logits(members), self.examples.labels[self.answered], int(self.answered.sum()))


def choose(wrong: list[np.ndarray]) -> tuple[int, list[float]]:
    """The first candidate whose error exceeds the lowest by at most one standard error of the difference.

    Args:
        wrong: of each candidate, the share of wrong answers (G,) to the recordings of each group.

    Returns:
        Its number, and the standard error of each candidate, over groups; 0 of one group.
    """
    more = [each - min(wrong, key=np.mean) for each in wrong]
    above = [float(each.std(ddof=1) / len(each) ** 0.5) if len(each) > 1 else 0.0 for each in more]
    return next(number for number, each in enumerate(more) if each.mean() <= above[number]), above


def choose_members(left: LeftOut, candidates: list[list[str]]) -> tuple[list[str], list[Note]]:
    """Compare the candidates, up to the first that errs nowhere.

    Returns:
        The chosen members, and notes: the choice, then each candidate, the chosen one first and the others by their
        errors. The value of a candidate's note has its error, the standard error of the difference from the lowest, and
        the seconds of all fits.
    """
    key = "model.members"
    if not left.answered.any():
        text = "no object has two groups to train on, so that none can be left out: taken without a comparison"
        return candidates[0], [Note(text, "choice", "recogniser", key, candidates[0])]
    wrong = list[np.ndarray]()
    for members in candidates:
        if not wrong or wrong[-1].any():
            wrong.append(left.wrong(members))
    taken, above = choose(wrong)
    text = (
        f"of {several(len(wrong), 'candidate')} the first whose error is within a standard error of the lowest, on "
        f"{several(len(wrong[0]), 'training group')}, each left out of the fits that answer it"
    )
    notes = [Note(text, "choice", "recogniser", key, candidates[taken])]
    for number in sorted(range(len(wrong)), key=lambda number: (number != taken, wrong[number].mean())):
        members, error = candidates[number], float(wrong[number].mean())
        seconds = sum(left.seconds[name] for name in members)
        text = f"{' + '.join(members)}: {100 * error:.1f} % of whole recordings wrong, {seconds:.1f} s of fits"
        value = {"members": members, "taken": number == taken, "error": error, "standard_error": above[number]}
        notes.append(Note(text, topic="candidates", key=key, value=value | {"seconds": seconds}))
    return candidates[taken], notes
