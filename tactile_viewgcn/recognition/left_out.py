"""Answers to recordings that are left out of the fits: the weights of the members and their calibration rest on them.

Nothing is pretrained for the members, so that a group can be left out of all that is fitted to
labels.
"""

from collections.abc import Sequence

import numpy as np

from tactile_viewgcn.frames.folds import complete_folds
from tactile_viewgcn.progress import steps
from tactile_viewgcn.recognition.calibration import fit_temperature, fit_weights
from tactile_viewgcn.sensors.estimators import added, log_shares, probabilities
from tactile_viewgcn.sensors.examples import Examples

FOLDS = 5
LEAST_WEIGHT = 0.1  # of the largest: a member with less is left out


class LeftOut:
    """Answers to training recordings by estimators that were fitted to other groups; a fifth is left out at a time.

    Every class of two groups or more is left out in turn, see `complete_folds`.

    Args:
        groups: (R,) split group of each of the examples' recordings.

    Attributes:
        folds: masks bool (R,) of the recordings that are left out together.
        answered: bool (R,) recordings by whose answers everything here is measured.
        shares: by member, probabilities (R, classes), means over a recording's points; 0 of
            recordings that were never left out.
    """

    def __init__(self, examples: Examples, groups: np.ndarray, seed: int):
        self.examples, self.groups, self._seed = examples, groups, seed
        self.folds = complete_folds(groups, examples.labels, FOLDS)
        self.answered = (
            np.any(self.folds, axis=0) if self.folds else np.zeros(len(groups), dtype=bool)
        )
        self.shares = dict[str, np.ndarray]()

    def answers(self, members: Sequence[str]) -> list[np.ndarray]:
        """The `shares` (n, classes) of some members for the answered recordings; each member's are computed once."""
        for member in set(members) - self.shares.keys():
            examples, (points, recording) = self.examples, self.examples.of_recordings(member)
            shares, label = (
                np.zeros((len(points), examples.classes), dtype=np.float32),
                examples.labels[recording],
            )
            for fold in steps(self.folds, f"{member}, groups left out", "folds"):
                left = fold[recording]
                estimator = examples.representation.estimator(member, quick=True)
                estimator.fit(points[~left], label[~left], self._seed)
                shares[left] = probabilities(estimator, points[left], examples.classes)
            means = [shares[recording == each].mean(axis=0) for each in range(len(self.groups))]
            self.shares[member] = np.stack(means)
        return [self.shares[member][self.answered] for member in members]

    def wrong(self, weights: dict[str, float]) -> np.ndarray:
        """Share of wrong answers (G,) by weighed members in each group that was answered."""
        wrong = self._sum(weights).argmax(axis=1) != self.examples.labels[self.answered]
        place = np.unique(self.groups[self.answered], return_inverse=True)[1]
        return np.bincount(place, wrong) / np.bincount(place)

    def weighed(self, members: list[str]) -> dict[str, float]:
        """Weights of the members' log-probabilities, fitted to their answers.

        Members of little weight are left out, and the others are weighed anew.
        """
        weights = fit_weights(
            log_shares(self.answers(members)), self.examples.labels[self.answered]
        )
        enough = weights >= LEAST_WEIGHT * weights.max()
        if enough.all():
            return dict(zip(members, weights.tolist(), strict=True))
        return self.weighed([name for name, kept in zip(members, enough, strict=True) if kept])

    def temperature(self, weights: dict[str, float]) -> float | None:
        """The temperature of the weighed sum, fitted to the answers; None without any."""
        return (
            fit_temperature(self._sum(weights), self.examples.labels[self.answered])
            if self.answered.any()
            else None
        )

    def _sum(self, weights: dict[str, float]) -> np.ndarray:
        """The weighed sum (n, classes) of log-probabilities."""
        return added(self.answers([*weights]), [*weights.values()])
