"""Comparison of a study's variants: errors with intervals, paired differences to the references, costs, power."""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t as student

from studies.cells import Answers
from studies.grid import COLUMNS
from studies.p_values import holm, sign_flip
from tactile_viewgcn.evaluation.predictions import Predictions
from tactile_viewgcn.intervals import group_interval, proportion_interval
from tactile_viewgcn.messages import UserError, several

MIN_SEEDS = 3  # for an interval over trainings
ENOUGH = 5.0  # points: largest acceptable value of the smallest difference that a study detects
WEIGHTINGS = ("frame", "group")  # the unit that counts once: an anchor, or a split group with the mean of its anchors
Training = tuple[int, int]  # seed and deal


@dataclass(frozen=True)
class Variant:
    """All trainings of one variant: the cells of all folds, by seed and deal.

    Arrays over anchors, (A,), have folds and deals side by side.
    """

    name: str
    trainings: dict[Training, list[Answers]]

    def tested(self, among: Collection[Training]) -> np.ndarray:
        """(2, A) names of the recordings and split groups of the anchors on which these trainings were tested.

        Raises:
            UserError: trainings on the same deal were tested on different anchors.
        """
        deals = self._by_deal(among, lambda fold: np.array((fold.recordings, fold.groups.astype(str))))
        if not all(np.array_equal(anchors, deal[0]) for deal in deals for anchors in deal):
            raise UserError(f"variant {self.name}: its trainings were tested on different view sets")
        return np.hstack([deal[0] for deal in deals])

    def wrong(self, protocol: str, among: Collection[Training]) -> np.ndarray:
        """(A,) share of wrong answers over seeds and trials of these trainings."""
        deals = self._by_deal(among, lambda fold: 1 - (fold.predicted[protocol] == fold.labels).mean(axis=0))
        return np.hstack([np.mean(deal, axis=0) for deal in deals])

    def _by_deal(
        self, among: Collection[Training], values: Callable[[Predictions], np.ndarray]
    ) -> list[list[np.ndarray]]:
        """For each deal the `values` of its trainings, folds side by side."""
        deals: dict[int, list[np.ndarray]] = {deal: [] for deal in sorted(deal for _, deal in among)}
        for seed, deal in sorted(among):
            deals[deal].append(np.hstack([values(each.predictions) for each in self.trainings[seed, deal]]))
        return list(deals.values())

    def cost(self, name: str) -> float:
        """The least over the trainings, of a cost that is summed over folds (seconds) or the largest of all folds."""
        total = sum if name.endswith(" s") else max
        return float(min(total(each.costs[name] for each in folds) for folds in self.trainings.values()))


def pooled(answers: Iterable[Answers]) -> list[Variant]:
    """The variants in the order of their appearance, without trainings that lack a fold.

    Raises:
        UserError: no training has all folds.
    """
    answers = list(answers)
    folds = len({each.cell.fold for each in answers})
    variants: dict[str, dict[Training, list[Answers]]] = {each.cell.variant: {} for each in answers}
    for each in sorted(answers, key=lambda each: each.cell.fold):
        variants[each.cell.variant].setdefault((each.cell.seed, each.cell.deal), []).append(each)
    whole = {
        name: {training: cells for training, cells in trainings.items() if len(cells) == folds}
        for name, trainings in variants.items()
    }
    trained = [Variant(name, trainings) for name, trainings in whole.items() if trainings]
    if not trained:
        raise UserError(
            f"no training has finished on all {folds} folds, so that there is no table: run the study again"
        )
    return trained


def rows_of(variants: list[Variant], references: Iterable[str], rng: np.random.Generator) -> pd.DataFrame:
    """A row for each protocol, weighting and variant, in per cent; NaN stands for a missing number.

    The columns `vs R more`, `low`, `high` and `p` have the paired difference to the reference R, NaN for R itself, and
    `seeds_low` and `seeds_high` its interval over trainings. In a crossed study `A / x` is compared with `R / x`. The
    p values of a protocol and weighting are corrected together, for all references.

    Raises:
        UserError: a variant and a reference were tested on different view sets.
    """
    by_name, rows = {variant.name: variant for variant in variants}, []
    for protocol in next(iter(variants[0].trainings.values()))[0].predictions.predicted:
        for weighting in WEIGHTINGS:
            together = []
            for variant in variants:
                wrong, groups = weighted(variant.wrong(protocol, variant.trainings), variant, weighting)
                errors = [100 * variant.wrong(protocol, {training}).mean() for training in variant.trainings]
                row: dict[str, Any] = {"variant": variant.name, "protocol": protocol, "weighting": weighting}
                row |= percent(("error", "low", "high"), wrong, proportion_interval(wrong, groups, rng))
                spread = np.std(errors, ddof=1) if len(errors) > 1 else np.nan
                row |= {"trainings": len(errors), "std": spread} | {name: variant.cost(name) for name in COLUMNS}
                for name in references:
                    reference = by_name.get(name) or by_name.get(f"{name} / {variant.name.partition(' / ')[2]}")
                    row |= compared(variant, reference, protocol, weighting, f"vs {name} ", rng)
                together.append(row)
            ps = [(row, name) for row in together for name in row if name.endswith(" p") and not np.isnan(row[name])]
            for (row, name), p in zip(ps, holm([row[name] for row, name in ps]), strict=True):
                row[name] = p
            rows += together
    return pd.DataFrame(rows)


def weighted(
    values: np.ndarray, variant: Variant, weighting: str, among: Collection[Training] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Values (A,) and their groups; for the weighting `group` the mean (G,) of each group, and the groups' names."""
    groups = variant.tested(among or variant.trainings)[1]
    if weighting == "frame":
        return values, groups
    names, place = np.unique(groups, return_inverse=True)
    return np.bincount(place.ravel(), weights=values) / np.bincount(place.ravel()), names


def percent(names: tuple[str, ...], values: np.ndarray, ends: tuple[float, float] | None) -> dict[str, float]:
    """The mean of values and the ends of its interval, in per cent, under these names."""
    return dict(zip(names, (100 * float(end) for end in (values.mean(), *(ends or (np.nan, np.nan)))), strict=True))


def compared(
    variant: Variant, reference: Variant | None, protocol: str, weighting: str, head: str, rng: np.random.Generator
) -> dict[str, float]:
    """The paired difference over common seeds and deals; NaN for the reference itself, or without common trainings."""
    names = tuple(f"{head}{name}" for name in ("more", "low", "high", "p", "seeds_low", "seeds_high"))
    row = dict.fromkeys(names, np.nan)
    common = variant.trainings.keys() & reference.trainings.keys() if reference else set()
    if reference is None or variant is reference or not common:
        return row
    if not np.array_equal(variant.tested(common), reference.tested(common)):
        raise UserError(
            f"variant {variant.name} was tested on other view sets than {reference.name}; set reference: null"
        )
    more = variant.wrong(protocol, common) - reference.wrong(protocol, common)
    values, groups = weighted(more, variant, weighting, common)
    row |= percent(names[:3], values, group_interval(values, groups, rng)) | {names[3]: sign_flip(values, groups, rng)}
    if weighting == "frame" and len(common) >= MIN_SEEDS and len({deal for _, deal in common}) == 1:
        # Student's interval of the mean difference; trainings on several deals share groups and are not independent
        first, second = (
            np.array([each.wrong(protocol, {one}).mean() for one in sorted(common)]) for each in (variant, reference)
        )
        seeds = 100 * (first - second)
        half = student.ppf(0.975, len(seeds) - 1) * seeds.std(ddof=1) / len(seeds) ** 0.5
        row |= dict(zip(names[4:], (seeds.mean() - half, seeds.mean() + half), strict=True))
    return row


def sequential_rows(variants: list[Variant]) -> pd.DataFrame:
    """Rows of recognition frame by frame: the error by the number of views, and with a stop at a confidence.

    They are means over the cells of a variant, with an interval if there is one cell; `frames` is the mean number of
    frames.
    """
    rows = []
    for variant in variants:
        scores = [each.sequential for folds in variant.trainings.values() for each in folds if each.sequential]
        for frames in [*scores[0]["by_views"], "stop"] if scores else []:
            errors = [score["by_views"].get(frames, score["error"]) for score in scores]
            alone = len(errors) == 1 and errors[0]["low"] is not None
            ends = (errors[0]["low"], errors[0]["high"]) if alone else None
            place = f"stops at {scores[0]['confidence_threshold']:g}" if frames == "stop" else f"{frames} frames"
            row = {"variant": f"{variant.name}, {place}", "protocol": "recording", "trainings": len(variant.trainings)}
            row |= percent(("error", "low", "high"), np.array([error["mean"] for error in errors]), ends)
            taken = [score["frames"] if frames == "stop" else float(frames) for score in scores]
            rows.append(row | {"frames": float(np.mean(taken))})
    return pd.DataFrame(rows)


def power(rows: pd.DataFrame, groups: int) -> str:
    """A sentence on the smallest difference that the study detects: half of the widest interval of each kind."""
    protocol, widest = rows["protocol"].iloc[-1], {}
    for kind, weighting, end in (
        ("per frame", "frame", " "),
        ("per group", "group", " "),
        ("over trainings", "frame", " seeds_"),
    ):
        chosen = rows[(rows["protocol"] == protocol) & (rows["weighting"] == weighting)]
        low, high = (chosen.filter(regex=f"{end}{side}$").to_numpy() for side in ("low", "high"))
        if not np.isnan(high - low).all():
            widest[kind] = np.nanmax(high - low) / 2
    most = max(widest.values(), default=0)
    if not most:
        why = "All compared variants answered alike" if widest else "Nothing is compared in pairs here"
        return f"{why}, so no smallest difference can be stated."
    verdict = (
        f"below {ENOUGH:g} points: where it shows no difference, there is no larger one"
        if most < ENOUGH
        else f"above {ENOUGH:g} points: where it shows no difference there may be one, and it needs more data"
    )
    points = ", ".join(f"{width:.1f} points {kind}" for kind, width in widest.items())
    return (
        f"The smallest difference that this study detects is {points} ({protocol} protocol, half of the "
        f"widest paired interval, {several(groups, 'split group')}), {verdict}."
    )


def with_seconds(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the `seconds` of both trainings."""
    return rows.assign(seconds=rows["pretrain s"] + rows["finetune s"])


def on_fronts(rows: pd.DataFrame) -> list[str]:
    """Variants that are on the front of seconds or of ms an answer, under any protocol; the cheapest to train first."""
    rows, names = with_seconds(rows), set[str]()
    for _, part in rows.groupby("protocol"):
        for cost in ("seconds", "ms alone"):
            names |= {*part["variant"].iloc[pareto_front(part[cost].to_numpy(), part["error"].to_numpy())]}
    return [name for name in rows.sort_values("seconds")["variant"].unique() if name in names]


def pareto_front(costs: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Indices of the points that no other point beats in cost or error without losing in the other, cheapest first."""
    order = np.lexsort((errors, costs))
    before = np.concatenate([[np.inf], np.minimum.accumulate(errors[order])[:-1]])
    return order[errors[order] < before]
