"""Members' answers to training recordings that were held out, and what follows from them.

Nothing is pretrained for the members. Hence a group can be held out of everything that is fitted to
labels.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from tactile_viewgcn.frames.folds import complete_folds
from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.member import Member
from tactile_viewgcn.members.weighted_sum import log_probabilities, weighted_sum
from tactile_viewgcn.progress import steps
from tactile_viewgcn.recognition.calibration import fit_temperature, fit_weights

FOLDS = 5  # of the training groups
LEAST_WEIGHT = 0.1  # share of the largest weight; a member with less is taken out


def out_of_fold_answers(
    member: Member, examples: Examples, folds: Sequence[np.ndarray], *, seed: int
) -> np.ndarray:
    """Return a member's answers to the recordings of each fold, by a fit to all other recordings.

    A copy of the member is fitted, and the member itself is not.

    Args:
        member: `Member.measure` was called.
        examples: the R training recordings.
        folds: masks bool (R,) of the recordings that are held out together.
        seed: of the fits.

    Returns:
        Probabilities float32 (R, classes); 0 for a recording that no fold holds out.

    Raises:
        UserError: the training of a network diverges.
    """
    answers = np.zeros((len(examples.labels), examples.classes), dtype=np.float32)
    for fold in steps(folds, f"{member.name}, groups held out", "folds"):
        fitted = copy(member)
        fitted.fit(examples, ~fold, seed=seed, quick=True)
        answers[fold] = fitted.answer_examples(examples, fold)
    return answers


@dataclass(frozen=True)
class OutOfFold:
    """The out-of-fold answers of members, and the weights, temperature and errors that follow.

    About five folds hold out each class that has two groups or more, see `complete_folds`. There
    are fewer folds if the classes have fewer groups, and more folds if groups span classes.

    Attributes:
        labels: (R,) class of each training recording.
        groups: (R,) group of each training recording, which is held out as a whole.
        folds: masks bool (R,) of the recordings that are held out together.
        answers: `out_of_fold_answers` (R, classes), by the member's name.
    """

    labels: np.ndarray
    groups: np.ndarray
    folds: list[np.ndarray]
    answers: dict[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def of(cls, labels: np.ndarray, groups: np.ndarray) -> "OutOfFold":
        """Return the folds of training recordings, without any answers yet.

        Args:
            labels: (R,) class of each recording.
            groups: (R,) group of each recording.
        """
        return cls(labels, groups, complete_folds(groups, labels, FOLDS))

    def with_member(self, member: Member, examples: Examples, *, seed: int) -> "OutOfFold":
        """Return a copy that also has a member's answers, see `out_of_fold_answers`."""
        answers = out_of_fold_answers(member, examples, self.folds, seed=seed)
        return replace(self, answers={**self.answers, member.name: answers})

    @property
    def held_out(self) -> np.ndarray:
        """Return which recordings a fold holds out, bool (R,); n is their number."""
        if not self.folds:
            return np.zeros(len(self.labels), dtype=bool)
        held_out: np.ndarray = np.any(self.folds, axis=0)
        return held_out

    def group_errors(self, weights: Mapping[str, float]) -> np.ndarray:
        """Return the share of wrong answers (G,) in each group that is held out.

        Args:
            weights: by name, the weights of the members that answer.
        """
        wrong = self._logits(weights).argmax(axis=1) != self.labels[self.held_out]
        group = np.unique(self.groups[self.held_out], return_inverse=True)[1]
        return np.bincount(group, wrong) / np.bincount(group)

    def member_weights(self, members: Sequence[str]) -> dict[str, float]:
        """Return the weights of the members' log-probabilities that fit the labels best.

        A member with less than `LEAST_WEIGHT` of the largest weight is taken out, and the other
        members are weighed again. There must be at least one fold.

        Args:
            members: names of members that have answers.
        """
        answers = [self.answers[name][self.held_out] for name in members]
        weights = fit_weights(log_probabilities(answers), self.labels[self.held_out])
        is_enough = weights >= LEAST_WEIGHT * weights.max()
        if is_enough.all():
            return dict(zip(members, weights.tolist(), strict=True))
        others = [name for name, is_taken in zip(members, is_enough, strict=True) if is_taken]
        return self.member_weights(others)

    def temperature(self, weights: Mapping[str, float]) -> float | None:
        """Return the temperature that calibrates the weighted sum; None if nothing is held out.

        Args:
            weights: by name, the weights of the members that answer.
        """
        if not self.folds:
            return None
        return fit_temperature(self._logits(weights), self.labels[self.held_out])

    def _logits(self, weights: Mapping[str, float]) -> np.ndarray:
        """Return the weighted sum (n, classes) of the members' log-probabilities."""
        answers = [self.answers[name][self.held_out] for name in weights]
        return weighted_sum(answers, list(weights.values()))
