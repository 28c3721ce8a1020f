"""The cells of a study put together: errors with intervals, paired differences to the reference, costs, power."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.cells import Answers
from studies.grid import COLUMNS
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.evaluation.statistics import confusion_counts, holm, sign_flip
from tactile_viewgcn.intervals import group_interval, proportion_interval

ENOUGH = 5.0  # points that a study is to be able to see


@dataclass(frozen=True)
class Variant:
    """All S trainings of one variant: by seed, its cells fold by fold. Arrays have the folds side by side."""

    name: str
    trainings: dict[int, list[Answers]]

    @property
    def answers(self) -> list[Answers]:
        return [each for folds in self.trainings.values() for each in folds]

    @property
    def tested(self) -> np.ndarray:
        """(2, A) names of the anchors' recordings and split groups.

        Raises:
            UserError: its trainings were tested on different anchors.
        """
        first, *others = (
            np.hstack([(each.predictions.recordings, each.predictions.groups.astype(str)) for each in folds])
            for folds in self.trainings.values()
        )
        if any(not np.array_equal(first, other) for other in others):
            raise UserError(f"variant {self.name}: its trainings were tested on different view sets; expected the same")
        return first

    def correct(self, protocol: str) -> np.ndarray:
        """bool (S, T, A)."""
        return np.stack([np.hstack([each.correct(protocol) for each in folds]) for folds in self.trainings.values()])

    def error(self, protocol: str) -> float:
        return 1 - float(self.correct(protocol).mean())

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


def pooled(answers: Iterable[Answers]) -> list[Variant]:
    """One for each name, in the order of their appearance; trainings that lack a fold are left out.

    Raises:
        UserError: no training has all folds.
    """
    answers = sorted(answers, key=lambda each: each.cell.fold)
    folds = len({each.cell.fold for each in answers})
    trainings: dict[str, dict[int, list[Answers]]] = {}
    for each in answers:
        trainings.setdefault(each.cell.variant, {}).setdefault(each.cell.seed, []).append(each)
    whole = {name: {seed: of for seed, of in each.items() if len(of) == folds} for name, each in trainings.items()}
    variants = [Variant(name, of_seeds) for name, of_seeds in whole.items() if of_seeds]
    if not variants:
        raise UserError(
            f"no training has finished on all {folds} folds, so that there is no table: run the study again"
        )
    return variants


def rows_of(variants: list[Variant], reference: str | None, rng: np.random.Generator) -> list[dict[str, Any]]:
    """A row for each protocol and variant, in per cent; differences and p are blank where there is no reference.

    Raises:
        UserError: a variant was tested on other view sets than the reference.
    """
    against = next((variant for variant in variants if variant.name == reference), None)
    rows = []
    for protocol in variants[0].answers[0].predictions.predicted:
        of_protocol = [_row(variant, against, protocol, rng) for variant in variants]
        compared = [row for row in of_protocol if row["p"] != ""]
        for row, p in zip(compared, holm([row["p"] for row in compared]), strict=True):
            row["p"] = p
        rows += of_protocol
    return rows


def _row(variant: Variant, against: Variant | None, protocol: str, rng: np.random.Generator) -> dict[str, Any]:
    correct = variant.correct(protocol)
    row: dict[str, Any] = {"variant": variant.name, "protocol": protocol, "trainings": len(variant.trainings)}
    wrong = _percent(1 - correct.mean(axis=(0, 1)), variant.tested[1], rng, proportion_interval)
    row |= dict(zip(("error", "low", "high"), wrong, strict=True))
    row["std"] = 100 * float(correct.mean(axis=(1, 2)).std(ddof=1)) if len(correct) > 1 else ""
    row |= _compared(variant, against, protocol, rng)
    return row | {name: variant.cost(name) for name in COLUMNS}


def sequential_rows(variants: list[Variant]) -> list[dict[str, Any]]:
    """Rows of recognition frame by frame: the error after 1 to V frames, and where it stops at a confidence.

    Means over the cells of a variant, with an interval where there is one cell; `frames` is the mean number of frames.
    """
    rows = []
    for variant in variants:
        scores = [each.sequential for each in variant.answers if each.sequential]
        for frames in [*scores[0]["fixed"], "stop"] if scores else []:
            of_cells = [score["fixed"].get(frames, score) for score in scores]
            ends = of_cells[0]["ci95"] if len(of_cells) == 1 else None
            row: dict[str, Any] = {"protocol": "recording", "trainings": len(variant.trainings)}
            row["variant"] = f"{variant.name}, at frame {frames}"
            if frames == "stop":
                row["variant"] = f"{variant.name}, stops at {scores[0]['confidence_threshold']:g}"
            row["error"] = 100 * float(np.mean([score["error"] for score in of_cells]))
            row |= {end: 100 * ends[end] for end in ("low", "high")} if ends else {}
            rows.append(row | {"frames": float(np.mean([float(score.get("mean", frames)) for score in of_cells]))})
    return rows


def _compared(variant: Variant, against: Variant | None, protocol: str, rng: np.random.Generator) -> dict[str, Any]:
    """The paired difference over common seeds; blank for the reference itself, or where no seed is common."""
    common = [seed for seed in variant.trainings if against and seed in against.trainings]
    if against is None or variant is against or not common:
        return dict.fromkeys(("more", "more low", "more high", "p"), "")
    if not np.array_equal(variant.tested, against.tested):
        raise UserError(
            f"variant {variant.name} was tested on other view sets than {against.name}; set reference: null"
        )
    right, left = (
        of.correct(protocol)[[list(of.trainings).index(seed) for seed in common]].mean(axis=(0, 1))
        for of in (against, variant)
    )
    groups = variant.tested[1]
    ends = dict(zip(("more", "more low", "more high"), _percent(right - left, groups, rng), strict=True))
    return ends | {"p": sign_flip(right - left, groups, rng)}


def _percent(values: np.ndarray, groups: np.ndarray, rng: np.random.Generator, interval=group_interval) -> tuple:
    """Mean of values (A,) and its interval, in per cent; an interval needs two groups."""
    ends = interval(values, groups, rng)
    return 100 * float(values.mean()), *((100 * end for end in ends) if ends else ("", ""))


def power(rows: list[dict[str, Any]], groups: int) -> str:
    """A sentence on the smallest difference that could have been seen: the half-width of the widest paired interval."""
    protocol = rows[-1]["protocol"]
    compared = [row for row in rows if row["protocol"] == protocol and row["more low"] != ""]
    widths = [(row["more high"] - row["more low"]) / 2 for row in compared]
    if not widths:
        return "Nothing is compared in pairs here, so no smallest difference can be stated."
    verdict = (
        f"below {ENOUGH:g} points: where it shows no difference, there is no larger one"
        if max(widths) < ENOUGH
        else f"above {ENOUGH:g} points: where it shows no difference there may be one, and it needs more data"
    )
    return (
        f"The smallest difference that this study could have seen is {max(widths):.1f} points ({protocol} protocol, "
        f"half-width of the widest paired interval, {groups} split groups), {verdict}."
    )


def pareto_front(costs: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Indices of the points that no other is as cheap and as good as, and better in one; from the cheapest on."""
    order = np.lexsort((errors, costs))
    before = np.concatenate([[np.inf], np.minimum.accumulate(errors[order])[:-1]])
    return order[errors[order] < before]


def confused_pairs(table: np.ndarray, classes: list[str], count: int = 6) -> list[dict[str, Any]]:
    """The pairs with the highest share of the view sets of either object that were taken for the other.

    Args:
        table: (C, C) counts, a row the object held.
    """
    held, wrong = table.sum(axis=1), table + table.T
    share = wrong / np.maximum(held[:, None] + held, 1)
    first, second = np.triu_indices(len(classes), k=1)
    return [
        {
            "object": classes[i],
            "and": classes[j],
            "taken for each other, %": 100 * float(share[i, j]),
            "first for second, %": 100 * float(table[i, j] / max(1, held[i])),
            "second for first, %": 100 * float(table[j, i] / max(1, held[j])),
        }
        for i, j in ((first[k], second[k]) for k in np.argsort(-share[first, second], kind="stable")[:count])
    ]
