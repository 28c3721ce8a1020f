"""The trainings of each variant put together: what it was tested on, how often it was right, what it cost."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np

from studies.cells import Answers
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.evaluation.statistics import confusion_counts

Training = tuple[int, int]  # seed and deal


@dataclass(frozen=True)
class Variant:
    """All trainings of one variant: by seed and deal, its cells fold by fold.

    Arrays over anchors, (A,), have folds and deals side by side. An anchor's split group has one number in all of them.
    """

    name: str
    trainings: dict[Training, list[Answers]]

    @property
    def answers(self) -> list[Answers]:
        return [each for folds in self.trainings.values() for each in folds]

    def tested(self, among: Collection[Training] | None = None) -> np.ndarray:
        """(2, A) names of the anchors' recordings and split groups, of these trainings or of all.

        Raises:
            UserError: trainings on the same deal were tested on different anchors.
        """
        deals = []
        for trainings in self._by_deal(among):
            first, *others = (
                np.hstack([(each.predictions.recordings, each.predictions.groups.astype(str)) for each in folds])
                for folds in trainings
            )
            if any(not np.array_equal(first, other) for other in others):
                raise UserError(
                    f"variant {self.name}: its trainings were tested on different view sets; expected the same"
                )
            deals.append(first)
        return np.hstack(deals)

    def correct(self, protocol: str, among: Collection[Training] | None = None) -> np.ndarray:
        """(A,) share of seeds and trials that were right, of these trainings or of all."""
        return np.hstack(
            [
                np.mean([np.hstack([each.correct(protocol) for each in folds]) for folds in trainings], axis=(0, 1))
                for trainings in self._by_deal(among)
            ]
        )

    def errors(self, protocol: str, among: Collection[Training] | None = None) -> list[float]:
        """The error of each training, of these or of all; every anchor counts once."""
        trainings = [folds for training, folds in self.trainings.items() if among is None or training in among]
        right = [np.hstack([each.correct(protocol) for each in folds]) for folds in trainings]
        return [1 - float(each.mean()) for each in right]

    def cost(self, name: str) -> float:
        """Median over the trainings: of seconds summed over the folds, of everything else in the hungriest one."""
        total = sum if name.endswith(" s") else max
        return float(np.median([total(each.costs[name] for each in folds) for folds in self.trainings.values()]))

    def confusion(self, protocol: str, classes: list[str]) -> np.ndarray:
        """int64 (C, C): how often each class, a row, was answered with each, over all trainings and trials."""
        counts = np.zeros((len(classes), len(classes)), dtype=np.int64)
        for given in (each.predictions for each in self.answers):
            places = [classes.index(name) for name in given.classes]  # a fold may lack classes
            counts[np.ix_(places, places)] += confusion_counts(given.labels, given.predicted[protocol], len(places))
        return counts

    def mean_frame(self, name: str) -> np.ndarray:
        """(H, W) mean network input of a class over the evaluated sides that have it."""
        frames = [
            given.mean_frames[place]
            for given in (each.predictions for each in self.answers)
            for place in np.flatnonzero(given.classes == name)
            if place in given.labels
        ]
        return np.mean(frames, axis=0) if frames else np.zeros_like(self.answers[0].predictions.mean_frames[0])

    def _by_deal(self, among: Collection[Training] | None) -> list[list[list[Answers]]]:
        """The trainings on each deal, in the order of the deals."""
        deals: dict[int, list[list[Answers]]] = {}
        for training in sorted(self.trainings):
            if among is None or training in among:
                deals.setdefault(training[1], []).append(self.trainings[training])
        return [deals[deal] for deal in sorted(deals)]


def pooled(answers: Iterable[Answers]) -> list[Variant]:
    """One for each name, in the order of their appearance; trainings that lack a fold are left out.

    Raises:
        UserError: no training has all folds.
    """
    answers = list(answers)
    names, number = (
        list(dict.fromkeys(each.cell.variant for each in answers)),
        len({each.cell.fold for each in answers}),
    )
    trainings: dict[str, dict[Training, list[Answers]]] = {name: {} for name in names}
    for each in sorted(answers, key=lambda each: each.cell.fold):
        trainings[each.cell.variant].setdefault((each.cell.seed, each.cell.deal), []).append(each)
    whole = {
        name: {training: folds for training, folds in each.items() if len(folds) == number}
        for name, each in trainings.items()
    }
    variants = [Variant(name, of_name) for name, of_name in whole.items() if of_name]
    if not variants:
        raise UserError(
            f"no training has finished on all {number} folds, so that there is no table: run the study again"
        )
    return variants
