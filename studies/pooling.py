"""The trainings of each arm of a study, put together over seeds and folds."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from studies.arms import Arm


@dataclass(frozen=True)
class Pooled:
    """All trainings of one arm, the test sides of its folds side by side.

    Attributes:
        name: of the arm.
        seeds: of the S trainings; one that was repeated otherwise is there more than once.
        predicted: by protocol, (S, T, A); labels, groups: (A,).
        costs: of each training, {name: value}.
        classes: names.
    """

    name: str
    seeds: list[int]
    predicted: dict[str, np.ndarray]
    labels: np.ndarray
    groups: np.ndarray
    costs: list[dict[str, float]]
    classes: list[str]

    def right(self, protocol: str) -> np.ndarray:
        """bool (S, T, A)."""
        return self.predicted[protocol] == self.labels

    def error(self, protocol: str) -> float:
        return 1 - float(self.right(protocol).mean())

    def confusion(self, protocol: str) -> np.ndarray:
        """int64 (C, C): how often each class, a row, was answered with each, over all trainings and trials."""
        predicted, classes = self.predicted[protocol].astype(np.int64), len(self.classes)
        cells = np.broadcast_to(self.labels * classes, predicted.shape) + predicted
        return np.bincount(cells.ravel(), minlength=classes**2).reshape(classes, classes)


def pooled(arms: Iterable[Arm]) -> list[Pooled]:
    """One for each name, in the order of their appearance.

    Raises:
        ValueError: the trainings of an arm have different recipes, folds, anchors or protocols.
    """
    arms = list(arms)
    classes = list(dict.fromkeys(name for arm in arms for name in arm.classes))  # a fold may lack some
    by_name: dict[str, dict[tuple[int, int], dict[int, Arm]]] = {}
    for arm in arms:
        by_name.setdefault(arm.name, {}).setdefault((arm.seed, arm.repeat), {})[arm.fold] = arm
    return [_pool(name, trainings, classes) for name, trainings in by_name.items()]


def _pool(name: str, trainings: dict[tuple[int, int], dict[int, Arm]], classes: list[str]) -> Pooled:
    every = [[folds[number] for number in sorted(folds)] for folds in trainings.values()]  # by training, then fold
    first = every[0]
    for own in every:
        _refuse_others(name, own, first)
    return Pooled(
        name,
        [seed for seed, _ in trainings],
        {
            protocol: np.stack(
                [
                    np.concatenate([_renamed(arm.predicted[protocol], arm, classes) for arm in own], axis=1)
                    for own in every
                ]
            )
            for protocol in first[0].predicted
        },
        np.concatenate([_renamed(arm.labels, arm, classes) for arm in first]),
        np.concatenate([arm.groups for arm in first]),
        [_costs(own) for own in every],
        classes,
    )


def _refuse_others(name: str, own: list[Arm], first: list[Arm]) -> None:
    """ValueError unless one training's folds are what the first one's are."""
    alike = [arm.fold for arm in own] == [arm.fold for arm in first] and all(
        np.array_equal(a.groups, b.groups) and np.array_equal(a.labels, b.labels) and a.classes == b.classes
        for a, b in zip(own, first, strict=True)
    )
    if not alike:
        raise ValueError(f"arm {name}: seed {own[0].seed} has other folds or anchors than seed {first[0].seed}")
    shapes = [{protocol: len(values) for protocol, values in arm.predicted.items()} for arm in own + first]
    if any(arm.recipe != first[0].recipe for arm in own) or any(shape != shapes[0] for shape in shapes):
        raise ValueError(
            f"arm {name}: seed {own[0].seed} was trained or tested with other parameters than seed {first[0].seed}; "
            "delete what an earlier run has left in the folder of arms"
        )


def _renamed(values: np.ndarray, arm: Arm, classes: list[str]) -> np.ndarray:
    """Classes of an arm as places in a common list of names."""
    return np.array([classes.index(name) for name in arm.classes])[values]


def _costs(folds: list[Arm]) -> dict[str, float]:
    """Seconds summed over the folds, everything else as in the hungriest."""
    return {
        name: (sum if name in ("pretrain", "finetune") else max)(fold.costs[name] for fold in folds)
        for name in folds[0].costs
    }
