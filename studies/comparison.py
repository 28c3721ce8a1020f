"""Comparison of a study's variants: errors with intervals, paired differences to the references, costs, power."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t as student

from studies.cells import Answers
from studies.grid import COLUMNS
from tactile_viewgcn.evaluation.trials import ASKED
from tactile_viewgcn.intervals import group_interval, proportion_interval
from tactile_viewgcn.messages import UserError, several
from tactile_viewgcn.randomness import stream

MIN_SEEDS = 3  # for an interval over trainings
ENOUGH = 5.0  # points: largest acceptable detectable difference of a study
OPEN, UNTRAINED = "not decided", "not trained to its end"
TRAINING = ["seed", "deal"]  # a training is the cells of all folds
# trainings are paired on one kind of machine: they differ by points
PAIRED = [*TRAINING, "machine"]


def complete(answers: list[Answers], folds: int) -> list[Answers]:
    """The answers without those of trainings that lack one of the folds.

    Raises:
        UserError: no training has all folds.
    """
    trainings = pd.Series([(each.cell.variant, each.cell.seed, each.cell.deal) for each in answers])
    whole = [
        each
        for each, count in zip(answers, trainings.map(trainings.value_counts()), strict=True)
        if count == folds
    ]
    if not whole:
        raise UserError(
            f"no training has finished on all {folds} folds, so that there is no table: run the study again"
        )
    return whole


def errors_of(answers: list[Answers]) -> pd.DataFrame:
    """Rows of variant, training, protocol and split group, with machine, number of answers and share of wrong ones.

    `protocol` has the titles of `trials.ASKED`; `wrong` is a mean over the group's answers and all
    trials.
    """
    parts = []
    for each in answers:
        cell = each.cell
        for asked, trials in each.predictions.trials.items():
            wrong = pd.Series(1 - trials.correct.mean(axis=0))
            part = (
                wrong.groupby(trials.groups)
                .agg(answers="size", wrong="mean")
                .rename_axis("group")
                .reset_index()
            )
            training = {"seed": cell.seed, "deal": cell.deal, "machine": each.machine}
            parts.append(part.assign(variant=cell.variant, protocol=ASKED[asked], **training))
    rows = pd.concat(parts, ignore_index=True)
    machines = rows.groupby(["variant", *TRAINING])["machine"]  # of a training's folds
    return rows.assign(machine=machines.transform(lambda names: ", ".join(sorted(set(names)))))


def costs_of(answers: list[Answers]) -> pd.DataFrame:
    """Costs of the cheapest training of each variant: seconds summed over folds, other costs the maximum over folds."""
    rows = [vars(each.cell) | each.costs for each in answers]
    over_folds = {name: "sum" if name.endswith(" s") else "max" for name in COLUMNS}
    return (
        pd.DataFrame(rows).groupby(["variant", *TRAINING]).agg(over_folds).groupby("variant").min()
    )


def trainings_of(answers: list[Answers]) -> pd.DataFrame:
    """Mean losses of each variant, whether all of its cells are trained to their end, and the machines."""
    rows = [
        {"variant": each.cell.variant, "machine": each.machine} | vars(each.losses)
        for each in answers
    ]
    functions = dict.fromkeys(("guessing", "before", "end"), "mean") | {"trained": "all"}
    return (
        pd.DataFrame(rows)
        .groupby("variant")
        .agg(functions | {"machine": lambda names: ", ".join(names.unique())})
    )


def rows_of(answers: list[Answers], references: Iterable[str]) -> pd.DataFrame:
    """A row for each protocol and variant, in per cent; every split group counts once. NaN: a missing number.

    The columns `vs R more`, `low` and `high` have the paired difference to the reference R and its
    interval over groups, NaN for R itself; `seeds_low` and `seeds_high` are its interval over
    trainings, and `verdict` needs both intervals, and both trained to their end. In a crossed study
    `A / x` is compared with `R / x`.

    Raises:
        UserError: a variant and a reference were tested on different view sets.
    """
    errors, once, rows = errors_of(answers), costs_of(answers).join(trainings_of(answers)), []
    for protocol, of_protocol in errors.groupby("protocol", sort=False):
        parts = dict(iter(of_protocol.groupby("variant", sort=False)))
        for name, part in parts.items():
            by_group = part.groupby("group")["wrong"].mean()
            trainings = 100 * part.groupby(TRAINING)["wrong"].mean()
            row: dict[str, Any] = {"variant": name, "protocol": protocol}
            row |= percent(("error", "low", "high"), by_group, proportion_interval)
            row |= {"trainings": len(trainings), "std": trainings.std()} | dict(once.loc[name])
            for reference in references:
                same_place = f"{reference} / {name.partition(' / ')[2]}"
                other = reference if reference in parts else same_place
                row |= compared(
                    part, parts.get(other) if other != name else None, f"vs {reference} "
                )
                trained = once["trained"].reindex([name, other]).all()
                row[f"vs {reference} verdict"] = (
                    verdict(row, f"vs {reference} ") if trained else UNTRAINED
                )
            rows.append(row)
    return pd.DataFrame(rows)


def percent(
    names: tuple[str, ...], by_group: pd.Series, interval: Callable[..., tuple[float, float] | None]
) -> dict[str, float]:
    """The groups' mean and the ends of its interval, in per cent, under these names; all draw the same numbers."""
    ends = interval(by_group.to_numpy(), by_group.index.to_numpy(), stream(0, "study")) or (
        np.nan,
        np.nan,
    )
    return {
        name: 100 * float(value)
        for name, value in zip(names, (by_group.mean(), *ends), strict=True)
    }


def compared(part: pd.DataFrame, reference: pd.DataFrame | None, head: str) -> dict[str, float]:
    """The paired difference over common trainings; NaN for the reference itself, or without common trainings."""
    names = tuple(f"{head}{name}" for name in ("more", "low", "high", "seeds_low", "seeds_high"))
    row = dict.fromkeys(names, np.nan)
    if reference is None:
        return row
    ours, theirs = (
        one.merge(other[PAIRED].drop_duplicates())
        for one, other in ((part, reference), (reference, part))
    )
    pairs = ours.merge(theirs, on=[*PAIRED, "group", "answers"], suffixes=("", " of the reference"))
    if pairs.empty and ours.empty:
        return row
    if not len(pairs) == len(ours) == len(theirs):
        ours, theirs = (one["variant"].iloc[0] for one in (part, reference))
        raise UserError(
            f"variant {ours} was tested on other view sets than {theirs}; set reference: null"
        )
    more = pairs.assign(more=pairs["wrong"] - pairs["wrong of the reference"])
    by_group, by_seed = (
        more.groupby("group")["more"].mean(),
        100 * more.groupby("seed")["more"].mean(),
    )
    row |= percent(names[:3], by_group, group_interval)
    if len(by_seed) >= MIN_SEEDS and more["deal"].nunique() == 1:
        # Student's interval of the mean difference; trainings on several deals share groups and are
        # not independent
        half = student.ppf(0.975, len(by_seed) - 1) * by_seed.std() / len(by_seed) ** 0.5
        row |= dict(zip(names[3:], (by_seed.mean() - half, by_seed.mean() + half), strict=True))
    return row


def verdict(row: dict[str, Any], head: str) -> str:
    """Whether a variant errs more or less than its reference by both intervals, else `OPEN`; empty without both."""
    lows, highs = (
        np.array([row[f"{head}{kind}{end}"] for kind in ("", "seeds_")]) for end in ("low", "high")
    )
    if np.isnan(lows).any():
        return ""
    return "errs more" if (lows > 0).all() else "errs less" if (highs < 0).all() else OPEN


def power(rows: pd.DataFrame, groups: int) -> str:
    """A sentence on the detectable difference: half of the widest interval over groups, and over trainings.

    Comparisons with what is not trained to its end do not count.
    """
    protocol, widest = rows["protocol"].iloc[-1], {}
    chosen = rows[rows["protocol"] == protocol]
    for verdicts in chosen.filter(regex="^vs .* verdict$"):
        ends = chosen.columns[chosen.columns.str.startswith(verdicts.removesuffix("verdict"))]
        chosen = chosen.assign(**chosen[ends].where(chosen[verdicts] != UNTRAINED))
    for kind, end in (
        (f"over {several(groups, 'split group')}", " "),
        ("over trainings", " seeds_"),
    ):
        low, high = (
            chosen.filter(regex=f"^vs .*{end}{side}$").to_numpy() for side in ("low", "high")
        )
        if not np.isnan(high - low).all():
            widest[kind] = np.nanmax(high - low) / 2
    most = max(widest.values(), default=0)
    if not most:
        why = (
            "All compared variants answered alike"
            if widest
            else "Nothing is compared in pairs here"
        )
        return f"{why}, so no detectable difference can be stated."
    verdict = (
        f"below {ENOUGH:g} points: where it shows no difference, there is no larger one"
        if most < ENOUGH
        else f"above {ENOUGH:g} points: where it shows no difference there may be one, and it needs more data"
    )
    points = ", ".join(f"{width:.1f} points {kind}" for kind, width in widest.items())
    return (
        f"The smallest difference that this study detects is {points} ({protocol}, half of the "
        f"widest paired interval), {verdict}."
    )


def pareto_front(costs: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Indices of the points that no other point beats in cost or error without losing in the other, cheapest first.

    Of points that are equal in both all belong to the front; a point without one of the two
    numbers, NaN, does not.
    """
    points = np.stack([costs, errors], axis=1)
    beaten = [((points <= one).all(axis=1) & (points < one).any(axis=1)).any() for one in points]
    outside = np.array(beaten, dtype=bool) | np.isnan(points).any(axis=1)
    return (order := np.lexsort((errors, costs)))[~outside[order]]
