"""The choice of a classifier for recordings, and its calibration, by recordings that are left out of its fits.

A candidate is one member of `sensors`, or several, or the network of the preset of this name. Channels have one recipe,
whose members are weighed. Nothing is pretrained for the members, so that a group can be left out of all that is fitted
to labels.
"""

from collections.abc import Sequence

import numpy as np

from tactile_viewgcn.frames.folds import left_out
from tactile_viewgcn.messages import Note, several
from tactile_viewgcn.recognition.calibration import fit_temperature, fit_weights
from tactile_viewgcn.recognition.network_candidate import NETWORK, NetworkCandidate
from tactile_viewgcn.sensors.estimators import added, log_shares, probabilities
from tactile_viewgcn.sensors.examples import Examples

#: a later candidate, last of all the network, is taken only if the earlier ones err more by more than a standard error
ARRAY: list[list[str]] = [["kernel", "pooled_kernel"], ["svm"]]
CHANNELS = ["trees", "svm", "convolutions"]
FOLDS = 5


class LeftOut:
    """Answers to training recordings by estimators that were fitted to other groups; a fifth is left out at a time.

    If a fold would remove a class from the training, that class's recordings are not left out.

    Args:
        groups: (R,) split group of each of the examples' recordings.

    Attributes:
        folds: masks bool (R,) of the recordings that are left out together.
        answered: bool (R,).
        shares: by member, probabilities (R, classes), means over a recording's points; 0 of recordings that were never
            left out.
    """

    def __init__(self, examples: Examples, groups: np.ndarray, seed: int):
        self.examples, self.groups, self._seed = examples, groups, seed
        self.folds = left_out(groups, examples.labels, FOLDS)
        self.answered = np.any(self.folds, axis=0) if self.folds else np.zeros(len(groups), dtype=bool)
        self.shares = dict[str, np.ndarray]()

    def answers(self, members: Sequence[str], rows: np.ndarray) -> list[np.ndarray]:
        """The `shares` of some members in those rows, bool (R,); each member's are computed once."""
        for member in set(members) - self.shares.keys():
            examples, (points, recording) = self.examples, self.examples.of_recordings(member)
            shares, label = np.zeros((len(points), examples.classes), dtype=np.float32), examples.labels[recording]
            for left in (left[recording] for left in self.folds):
                estimator = examples.representation.estimator(member, quick=True)
                estimator.fit(points[~left], label[~left], self._seed)
                shares[left] = probabilities(estimator, points[left], examples.classes)
            means = [shares[recording == each].mean(axis=0) for each in range(len(self.groups))]
            self.shares[member] = np.stack(means)
        return [self.shares[member][rows] for member in members]

    def wrong(self, members: Sequence[str], rows: np.ndarray, weights: Sequence[float] = ()) -> np.ndarray:
        """Share of wrong answers (G,) to those recordings, bool (R,), of each group that has any."""
        wrong = added(self.answers(members, rows), weights).argmax(axis=1) != self.examples.labels[rows]
        place = np.unique(self.groups[rows], return_inverse=True)[1]
        return np.bincount(place, wrong) / np.bincount(place)

    def calibrated(self, members: list[str], rows: np.ndarray, *, weighed: bool) -> tuple[list[float], float | None]:
        """Weights of the members' log-probabilities, all 1 unless `weighed`, and the temperature of their sum.

        Both are fitted to the answers to those recordings, bool (R,); without any the temperature is None.
        """
        weights, labels = [1.0] * len(members), self.examples.labels[rows]
        if not len(labels):
            return weights, None
        shares = self.answers(members, rows)
        if weighed:
            weights = fit_weights(log_shares(shares), labels).tolist()
        return weights, fit_temperature(added(shares, weights), labels, len(labels))


def choose(wrong: list[np.ndarray]) -> int:
    """The number of the first candidate whose error exceeds the lowest by at most one standard error of the difference.

    Args:
        wrong: of each candidate, the share of wrong answers (G,) to the recordings of each group, over which the
            standard error is taken; 0 of one group.
    """
    more = [each - min(wrong, key=np.mean) for each in wrong]
    above = [float(each.std(ddof=1) / len(each) ** 0.5) if len(each) > 1 else 0.0 for each in more]
    return next(number for number, each in enumerate(more) if each.mean() <= above[number])


def choose_members(
    left: LeftOut, candidates: list[list[str]], network: NetworkCandidate | None
) -> tuple[list[str], np.ndarray, list[Note]]:
    """Compare the candidates, up to the first that errs nowhere.

    Args:
        network: the last candidate, on as many folds as its limit of time allows; None: it is not asked.

    Returns:
        The chosen members, or `NETWORK`; the recordings bool (R,) that they have answered; and notes: the choice, then
        each candidate, the chosen one first and the others by their errors.
    """
    key, rows, notes, compared = "model.members", left.answered, list[Note](), list[list[str]]()
    if not rows.any():
        text = "no object has two groups to train on, so that none can be left out: taken without a comparison"
        return candidates[0], rows, [Note(text, "choice", "recogniser", key, candidates[0])]
    for members in candidates:
        if not compared or left.wrong(compared[-1], rows).any():
            compared.append(members)
    if network and left.wrong(compared[-1], rows).any():
        shares, answered, text = network.compare(left.folds)
        notes.append(Note(text, topic="recogniser"))
        if answered.any():
            left.shares[NETWORK], rows = shares, answered
            compared.append([NETWORK])
    wrong = [left.wrong(members, rows) for members in compared]
    taken, groups = choose(wrong), several(len(wrong[0]), "training group")
    text = f"of {several(len(wrong), 'candidate')} the first whose error is within a standard error of the lowest, "
    text += f"on {groups}, each left out of the fits that answer it"
    notes.append(Note(text, "choice", "recogniser", key, compared[taken]))
    for number in sorted(range(len(wrong)), key=lambda number: (number != taken, wrong[number].mean())):
        members, error = compared[number], float(wrong[number].mean())
        text = f"{' + '.join(members)}: {100 * error:.1f} % of whole recordings wrong"
        value = {"members": members, "taken": number == taken, "error": error}
        notes.append(Note(text, topic="candidates", key=key, value=value))
    return compared[taken], rows if compared[taken] == [NETWORK] else left.answered, notes
