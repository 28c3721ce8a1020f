"""Members' answers to training recordings that were held out of their fits, and what they tell.

Nothing is pretrained for the members, so that a group can be held out of all that is fitted to
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
LEAST_WEIGHT = 0.1  # of the largest: a member with less is taken out


def out_of_fold_answers(
    member: Member, examples: Examples, folds: Sequence[np.ndarray], *, seed: int
) -> np.ndarray:
    """Return a member's answers to the recordings of each fold, by a fit to all other recordings.

    The member itself is not fitted.

    Args:
        member: after `Member.measure`.
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

    About five folds hold out every class of two groups or more in turn, see `complete_folds`: there
    are fewer folds where classes have fewer groups, and more where groups span classes.

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
        """Return a copy that also has the answers of a member; see `out_of_fold_answers`."""
        answers = out_of_fold_answers(member, examples, self.folds, seed=seed)
        return replace(self, answers={**self.answers, member.name: answers})

    @property
    def held_out(self) -> np.ndarray:
        """Which recordings a fold holds out, bool (R,); there are n of them."""
        if not self.folds:
            return np.zeros(len(self.labels), dtype=bool)
        held_out: np.ndarray = np.any(self.folds, axis=0)
        return held_out

    def group_errors(self, weights: Mapping[str, float]) -> np.ndarray:
        """Return the share of wrong answers (G,) in each group that is held out.

        Args:
            weights: of the members that answer, by name.
        """
        wrong = self._logits(weights).argmax(axis=1) != self.labels[self.held_out]
        group = np.unique(self.groups[self.held_out], return_inverse=True)[1]
        return np.bincount(group, wrong) / np.bincount(group)

    def member_weights(self, members: Sequence[str]) -> dict[str, float]:
        """Return the weights of the members' log-probabilities that fit the labels best.

        A member of less than `LEAST_WEIGHT` of the largest weight is taken out, and the others are
        weighed anew.

        Args:
            members: names of members that have answers; there is at least one fold.
        """
        answers = [self.answers[name][self.held_out] for name in members]
        weights = fit_weights(log_probabilities(answers), self.labels[self.held_out])
        is_enough = weights >= LEAST_WEIGHT * weights.max()
        if is_enough.all():
            return dict(zip(members, weights.tolist(), strict=True))
        enough = [name for name, kept in zip(members, is_enough, strict=True) if kept]
        return self.member_weights(enough)

    def temperature(self, weights: Mapping[str, float]) -> float | None:
        """Return the temperature that calibrates the weighted sum; None if nothing is held out.

        Args:
            weights: of the members that answer, by name.
        """
        if not self.folds:
            return None
        return fit_temperature(self._logits(weights), self.labels[self.held_out])

    def _logits(self, weights: Mapping[str, float]) -> np.ndarray:
        """The weighted sum (n, classes) of the members' log-probabilities."""
        answers = [self.answers[name][self.held_out] for name in weights]
        return weighted_sum(answers, list(weights.values()))
