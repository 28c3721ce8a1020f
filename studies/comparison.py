"""Comparison of variants: errors, paired differences, costs, and what a study can detect."""

from collections.abc import Callable, Collection, Iterable
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t as student

from studies.cells import Answers
from studies.grid import COLUMNS
from tactile_viewgcn.evaluation.trials import TITLES
from tactile_viewgcn.intervals import group_interval, proportion_interval
from tactile_viewgcn.messages import UserError, several
from tactile_viewgcn.randomness import stream

Interval = Callable[[np.ndarray, np.ndarray, np.random.Generator], tuple[float, float] | None]

MIN_SEEDS = 3  # for an interval over seeds
ENOUGH_SEEDS = 5  # for a verdict
ENOUGH = 5.0  # percentage points: largest acceptable detectable difference of a study
HIGHER = "higher error"
LOWER = "lower error"
OPEN = "not decided"
UNTRAINED = "not trained to its end"
FEW_SEEDS = f"fewer than {ENOUGH_SEEDS} seeds"
ONE_WORLD = "one simulated world"
TRAINING = ["seed", "deal"]  # they name a training run, which has a cell for each fold
# the same seed gives errors that differ by percentage points between kinds of machines
PAIRED = [*TRAINING, "machine"]


def complete(answers: list[Answers], folds: int) -> list[Answers]:
    """Return the answers of training runs that have finished on all folds.

    Args:
        answers: answers of finished cells.
        folds: number of folds.

    Raises:
        UserError: no training run has all folds.
    """
    cells = [answer.cell for answer in answers]
    runs = pd.Series([(cell.variant, cell.seed, cell.deal) for cell in cells])
    finished_folds = runs.map(runs.value_counts())
    whole = [
        answer for answer, count in zip(answers, finished_folds, strict=True) if count == folds
    ]
    if not whole:
        raise UserError(
            f"no training run has finished on all {folds} folds, so there is no table; "
            "run the study again"
        )
    return whole


def errors_of(answers: list[Answers]) -> pd.DataFrame:
    """Return a row for each variant, training run, protocol and split group.

    Returns:
        Columns `variant`, `seed`, `deal`, `world` and `machine`; `protocol`, one of
            `trials.TITLES`; `group`, the world and the number of the group, since equal numbers in
            two worlds are two groups; `answers`, the number of answers of the group; and `wrong`,
            the share of wrong ones among its answers in all trials.
    """
    parts = []
    for answer in answers:
        for protocol, trials in answer.predictions.trials.items():
            wrong = pd.Series(1 - trials.correct.mean(axis=0))
            by_group = wrong.groupby(trials.groups).agg(answers="size", wrong="mean")
            part = by_group.rename_axis("group").reset_index()
            part["group"] = f"{answer.cell.world}/" + part["group"].astype(str)
            part["world"] = answer.cell.world
            part["seed"] = answer.cell.seed
            part["deal"] = answer.cell.deal
            part["machine"] = answer.machine
            part["variant"] = answer.cell.variant
            part["protocol"] = TITLES[protocol]
            parts.append(part)
    rows = pd.concat(parts, ignore_index=True)
    # the folds of a training run can come from several machines
    machines = rows.groupby(["variant", *TRAINING])["machine"]
    return rows.assign(machine=machines.transform(lambda names: ", ".join(sorted(set(names)))))


def costs_of(answers: list[Answers]) -> pd.DataFrame:
    """Return the costs of each variant, each the minimum over its training runs.

    Within a training run, seconds are summed over the folds. Of other costs the largest counts.

    Returns:
        Columns `grid.COLUMNS`, by variant.
    """
    rows = pd.DataFrame([vars(answer.cell) | answer.costs for answer in answers])
    over_folds = {name: "sum" if name.endswith(" s") else "max" for name in COLUMNS}
    of_runs = rows.groupby(["variant", *TRAINING]).agg(over_folds)
    return of_runs.groupby("variant").min()


def training_runs_of(answers: list[Answers]) -> pd.DataFrame:
    """Return the losses of each variant, whether it is trained, and its machines.

    Losses are means over its cells. A variant is trained if all its cells are.

    Returns:
        Columns of `losses.Losses` and `machine`, by variant.
    """
    rows = pd.DataFrame(
        [
            {"variant": answer.cell.variant, "machine": answer.machine} | vars(answer.losses)
            for answer in answers
        ]
    )
    functions: dict[str, Any] = {
        "first": "mean",
        "before": "mean",
        "end": "mean",
        "trained": "all",
        "machine": lambda names: ", ".join(names.unique()),
    }
    return rows.groupby("variant").agg(functions)


def rows_of(answers: list[Answers], references: Iterable[str]) -> pd.DataFrame:
    """Return a row for each protocol and variant, in per cent; every split group counts once.

    For each reference R there are columns that begin with `vs R `. `more` is the paired difference
    to R, `low` and `high` are its interval over groups, and `seeds_low` and `seeds_high` its
    interval over seeds. `verdict` is the text of the function `verdict`, or `UNTRAINED`. A missing
    number is NaN, as for R itself.

    Args:
        answers: answers of complete training runs.
        references: variants to compare with, or in a crossed study the first part of their names.

    Raises:
        UserError: a variant and a reference were tested on different view sets.
    """
    errors = errors_of(answers)
    once = costs_of(answers).join(training_runs_of(answers))
    rows = []
    for protocol, of_protocol in errors.groupby("protocol", sort=False):
        parts = dict(iter(of_protocol.groupby("variant", sort=False)))
        for variant, part in parts.items():
            row: dict[str, Any] = {"variant": variant, "protocol": protocol}
            row |= _error_columns(part) | dict(once.loc[variant])
            for reference in references:
                other = counterpart(variant, reference, parts)
                other_part = None
                if other != variant:
                    other_part = parts.get(other)
                head = f"vs {reference} "
                row |= compared(part, other_part, head)
                row[f"{head}verdict"] = UNTRAINED
                present = [name for name in (variant, other) if name in once.index]
                if once.loc[present, "trained"].all():
                    row[f"{head}verdict"] = verdict(row, head)
            rows.append(row)
    return pd.DataFrame(rows)


def _error_columns(part: pd.DataFrame) -> dict[str, Any]:
    """Return error, interval, number of training runs and their standard deviation, in per cent."""
    by_group = part.groupby("group")["wrong"].mean()
    of_runs = 100 * part.groupby(TRAINING)["wrong"].mean()
    columns: dict[str, Any] = percent(("error", "low", "high"), by_group, proportion_interval)
    columns["runs"] = len(of_runs)
    columns["std"] = of_runs.std()
    return columns


def counterpart(variant: str, reference: str, variants: Collection[str]) -> str:
    """Return the variant that a variant is compared with.

    It is the reference itself, if there is a variant of this name. Otherwise, in a crossed study,
    `A / x` is compared with `R / x`.

    Args:
        variant: name, such as `A / x`.
        reference: name, such as `R`.
        variants: names of all variants.
    """
    if reference in variants:
        return reference
    _, _, place = variant.partition(" / ")
    return f"{reference} / {place}"


def percent(
    names: tuple[str, str, str], by_group: "pd.Series[float]", interval: Interval
) -> dict[str, float]:
    """Return the groups' mean and the ends of its interval, in per cent.

    All intervals draw the same random numbers.

    Args:
        names: names of the mean and of the two ends.
        by_group: a value of each split group.
        interval: function of values, groups and a generator that returns the two ends.
    """
    ends = interval(by_group.to_numpy(), by_group.index.to_numpy(), stream(0, "study"))
    low, high = ends or (np.nan, np.nan)
    values = (by_group.mean(), low, high)
    return {name: 100 * float(value) for name, value in zip(names, values, strict=True)}


def compared(part: pd.DataFrame, reference: pd.DataFrame | None, head: str) -> dict[str, float]:
    """Return the paired difference to a reference over common training runs.

    Args:
        part: rows of a variant, see `errors_of`.
        reference: rows of the reference; None if the variant is the reference itself.
        head: beginning of the columns' names.

    Returns:
        Columns `more`, `low`, `high`, `seeds_low` and `seeds_high`, and the numbers of common
            `seeds` and of simulated `worlds`. All are NaN for the reference itself, and if the two
            have no common training runs.

    Raises:
        UserError: the two were tested on different view sets.
    """
    of_groups = (f"{head}more", f"{head}low", f"{head}high")
    of_seeds = (f"{head}seeds_low", f"{head}seeds_high")
    counts = (f"{head}seeds", f"{head}worlds")
    row = dict.fromkeys((*of_groups, *of_seeds, *counts), np.nan)
    if reference is None:
        return row
    ours = part.merge(reference[PAIRED].drop_duplicates())
    theirs = reference.merge(part[PAIRED].drop_duplicates())
    if ours.empty:
        return row
    pairs = ours.merge(
        theirs, on=[*PAIRED, "world", "group", "answers"], suffixes=("", " of the reference")
    )
    have_same_view_sets = len(pairs) == len(ours) and len(pairs) == len(theirs)
    if not have_same_view_sets:
        names = [rows["variant"].iloc[0] for rows in (part, reference)]
        raise UserError(
            f"variant {names[0]} was tested on other view sets than {names[1]}; "
            "write `reference: null` in the study's file"
        )
    pairs["more"] = pairs["wrong"] - pairs["wrong of the reference"]
    row |= percent(of_groups, pairs.groupby("group")["more"].mean(), group_interval)
    by_seed = 100 * pairs.groupby("seed")["more"].mean()
    row[f"{head}seeds"] = len(by_seed)
    row[f"{head}worlds"] = pairs.loc[pairs["world"] != "", "world"].nunique()
    # not for several deals: their training runs share groups, so they are not independent
    if len(by_seed) >= MIN_SEEDS and pairs["deal"].nunique() == 1:
        # Student's interval of the mean difference
        half = student.ppf(0.975, len(by_seed) - 1) * by_seed.std() / len(by_seed) ** 0.5
        row[of_seeds[0]] = by_seed.mean() - half
        row[of_seeds[1]] = by_seed.mean() + half
    return row


def verdict(row: dict[str, Any], head: str) -> str:
    """Return whether a variant has a higher or a lower error than its reference.

    Args:
        row: row with the columns of `compared`.
        head: beginning of their names.

    Returns:
        `HIGHER` or `LOWER` if both intervals say so, and `OPEN` if one of them has 0 in it. With
            too few seeds it is `FEW_SEEDS`. If all seeds have the same simulated recordings, it is
            `ONE_WORLD`, since they say nothing of other recordings. Empty if there is no difference
            or an interval is missing.
    """
    if np.isnan(row[f"{head}more"]):
        return ""
    seeds = row[f"{head}seeds"]
    if seeds < ENOUGH_SEEDS:
        return FEW_SEEDS
    lows = np.array([row[f"{head}low"], row[f"{head}seeds_low"]])
    highs = np.array([row[f"{head}high"], row[f"{head}seeds_high"]])
    if np.isnan(lows).any():
        return ""
    if row[f"{head}worlds"] == 1:
        return ONE_WORLD
    if (lows > 0).all():
        return HIGHER
    if (highs < 0).all():
        return LOWER
    return OPEN


def power(rows: pd.DataFrame, protocol: str, groups: int) -> str:
    """Return a sentence about the smallest difference that a study detects.

    This difference is half of the widest interval, given over groups and over seeds. Comparisons
    with a variant that is not trained to its end do not count.

    Args:
        rows: see `rows_of`.
        protocol: title of the protocol of the primary outcome; the others do not count.
        groups: number of split groups.
    """
    widths = _half_widths(rows[rows["protocol"] == protocol], groups)
    if not widths:
        return "Nothing is compared in pairs here, so no detectable difference can be stated."
    most = max(widths.values())
    if not most:
        return "All compared variants answered alike, so no detectable difference can be stated."
    if most < ENOUGH:
        meaning = (
            f"below {ENOUGH:g} points: where the study shows no difference, the intervals say how "
            "large one can still be"
        )
    else:
        meaning = (
            f"above {ENOUGH:g} points: where the study shows no difference there can still be one, "
            "and it takes more data to see it"
        )
    points = ", ".join(f"{width:.1f} points {kind}" for kind, width in widths.items())
    text = (
        f"The smallest difference that this study detects is {points} ({protocol}, half of the "
        f"widest paired interval), {meaning}."
    )
    if "over seeds" not in widths:
        text += " This holds for these training runs. Others can differ by more."
    return text


def _half_widths(rows: pd.DataFrame, groups: int) -> dict[str, float]:
    """Return half of the widest interval of a protocol's rows, by kind of interval."""
    rows = rows.copy()
    for verdict_column in rows.filter(regex="^vs .* verdict$"):
        head = verdict_column.removesuffix("verdict")
        columns = rows.columns[rows.columns.str.startswith(head)]
        is_untrained = rows[verdict_column] == UNTRAINED
        rows.loc[is_untrained, columns] = np.nan
    kinds = {f"over {several(groups, 'split group')}": " ", "over seeds": " seeds_"}
    widths = {}
    for kind, ends in kinds.items():
        low = rows.filter(regex=f"^vs .*{ends}low$").to_numpy()
        high = rows.filter(regex=f"^vs .*{ends}high$").to_numpy()
        if not np.isnan(high - low).all():
            widths[kind] = np.nanmax(high - low) / 2
    return widths


def pareto_front(costs: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Return the Pareto front: the points that no other point beats.

    A point beats another if it is better in cost or error and no worse in the other. Points that
    are equal in both numbers all belong to the front. A point without one of the numbers, NaN, does
    not belong to it.

    Args:
        costs: (n,) costs of the points.
        errors: (n,) errors of the points.

    Returns:
        Indices of the points on the front, the cheapest first.
    """
    points = np.stack([costs, errors], axis=1)
    is_outside = np.isnan(points).any(axis=1)
    for index, point in enumerate(points):
        no_worse = (points <= point).all(axis=1)
        better = (points < point).any(axis=1)
        if (no_worse & better).any():
            is_outside[index] = True
    order = np.lexsort((errors, costs))
    front: np.ndarray = order[~is_outside[order]]
    return front
