"""What the answers of an evaluation say of each object, and of the pairs that are mistaken for each other."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.evaluation.predictions import Predictions
from tactile_viewgcn.evaluation.statistics import confusion_counts


@dataclass(frozen=True)
class ObjectAnswers:
    """The answers to view sets of one object.

    Attributes:
        recordings: that they are drawn around; answers: in all trials; wrong: how many of them.
        taken_for: the object that is named most often in its place, and how often; None where nothing is wrong.
    """

    name: str
    recordings: int
    answers: int
    wrong: int
    taken_for: tuple[str, int] | None

    @property
    def error(self) -> float:
        return self.wrong / self.answers


@dataclass(frozen=True)
class Pair:
    """Two objects, by their numbers: how many of the answers to the one name the other."""

    first: int
    second: int
    first_as_second: int
    second_as_first: int


def counts_of(predictions: Predictions, protocol: str) -> np.ndarray:
    """Counts (C, C) over all trials: row the true class, column the answer."""
    return confusion_counts(predictions.labels, predictions.predicted[protocol], len(predictions.classes))


def answers_by_object(predictions: Predictions, protocol: str) -> list[ObjectAnswers]:
    """The objects that were tested, the one with the highest error first."""
    counts, objects = counts_of(predictions, protocol), []
    for label, name in enumerate(predictions.classes):
        if not (answers := int(counts[label].sum())):
            continue
        others = counts[label].copy()
        others[label] = 0
        other = int(others.argmax())
        taken_for = (str(predictions.classes[other]), int(others[other])) if others[other] else None
        recordings = len(np.unique(predictions.recordings[predictions.labels == label]))
        objects.append(ObjectAnswers(str(name), recordings, answers, int(others.sum()), taken_for))
    return sorted(objects, key=lambda each: -each.error)


def worst_pairs(predictions: Predictions, protocol: str, most: int) -> list[Pair]:
    """The pairs with most mistakes in both directions, the worst first; ties to the lowest numbers."""
    counts = counts_of(predictions, protocol)
    first, second = np.triu_indices(len(counts), k=1)
    both = counts[first, second] + counts[second, first]
    order = np.argsort(-both, kind="stable")[:most]
    pairs = [(int(first[i]), int(second[i])) for i in order if both[i]]
    return [Pair(a, b, int(counts[a, b]), int(counts[b, a])) for a, b in pairs]


def chance_error(predictions: Predictions) -> float:
    """Error of always naming the object that most view sets are of."""
    return float(1 - np.bincount(predictions.labels).max() / len(predictions.labels))
