"""The variants of a study compared: errors with intervals, paired differences to the references, costs, power."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.stats import t as student

from studies.grid import COLUMNS, crossed_name, name_and_place
from studies.variants import Variant
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.evaluation.statistics import holm, sign_flip
from tactile_viewgcn.intervals import group_interval, proportion_interval

MIN_SEEDS = 3  # for an interval over trainings
ENOUGH = 5.0  # points that a study is to be able to see
WEIGHTINGS = ("frame", "group")  # what counts once: each anchor, or each split group with the mean of its anchors


def rows_of(variants: list[Variant], references: Iterable[str], rng: np.random.Generator) -> list[dict[str, Any]]:
    """A row for each protocol, weighting and variant, in per cent.

    Its `versus` has the paired difference to each reference: `more`, `low`, `high` and `p`, which are blank for the
    reference itself. A reference R of a crossed study is compared with `A / x` as `R / x`. The p values of a protocol
    and weighting are corrected together, whatever the reference.

    Raises:
        UserError: a variant was tested on other view sets than a reference.
    """
    by_name, rows = {variant.name: variant for variant in variants}, []

    def against(variant: Variant) -> dict[str, Variant | None]:
        place = name_and_place(variant.name)[1]
        return {name: by_name.get(name) or by_name.get(crossed_name(name, place)) for name in references}

    for protocol in variants[0].answers[0].predictions.predicted:
        for weighting in WEIGHTINGS:
            together = [_row(variant, against(variant), protocol, weighting, rng) for variant in variants]
            compared = [each for row in together for each in row["versus"].values() if each["p"] != ""]
            for each, p in zip(compared, holm([each["p"] for each in compared]), strict=True):
                each["p"] = p
            rows += together
    return rows


def weighted(values: np.ndarray, groups: np.ndarray, weighting: str) -> tuple[np.ndarray, np.ndarray]:
    """Values (A,) and their groups as they are, or for the weighting `group` the mean (G,) of each group."""
    if weighting == "frame":
        return values, groups
    names, place = np.unique(groups, return_inverse=True)
    return np.bincount(place.ravel(), weights=values) / np.bincount(place.ravel()), names


def _row(
    variant: Variant, against: dict[str, Variant | None], protocol: str, weighting: str, rng: np.random.Generator
) -> dict[str, Any]:
    row: dict[str, Any] = {"variant": variant.name, "protocol": protocol, "weighting": weighting}
    wrong, groups = weighted(1 - variant.correct(protocol), variant.tested()[1], weighting)
    row |= dict(zip(("error", "low", "high"), _percent(wrong, groups, rng, proportion_interval), strict=True))
    errors = variant.errors(protocol)
    row |= {"trainings": len(errors), "std": 100 * float(np.std(errors, ddof=1)) if len(errors) > 1 else ""}
    row["versus"] = {name: _compared(variant, each, protocol, weighting, rng) for name, each in against.items()}
    return row | {name: variant.cost(name) for name in COLUMNS}


def _compared(
    variant: Variant, reference: Variant | None, protocol: str, weighting: str, rng: np.random.Generator
) -> dict[str, Any]:
    """The paired difference over common seeds and deals; blank for the reference itself, or where none is common.

    `seeds_low` and `seeds_high` are the interval over trainings, see `_over_trainings`.
    """
    common = variant.trainings.keys() & reference.trainings.keys() if reference else set()
    if reference is None or variant is reference or not common:
        return dict.fromkeys(("more", "low", "high", "p", "seeds_low", "seeds_high"), "")
    tested = variant.tested(common)
    if not np.array_equal(tested, reference.tested(common)):
        raise UserError(
            f"variant {variant.name} was tested on other view sets than {reference.name}; set reference: null"
        )
    more = reference.correct(protocol, common) - variant.correct(protocol, common)
    values, groups = weighted(more, tested[1], weighting)
    ends = dict(zip(("more", "low", "high"), _percent(values, groups, rng), strict=True))
    seeds = dict.fromkeys(("seeds_low", "seeds_high"), "")
    if weighting == "frame":
        seeds = _over_trainings(variant, reference, protocol)
    return ends | {"p": sign_flip(values, groups, rng)} | seeds


def _over_trainings(variant: Variant, reference: Variant, protocol: str) -> dict[str, Any]:
    """Student's 95 % interval of the mean difference, per frame, that trainings from other seeds would have.

    It needs three seeds; trainings on several deals share their groups, and have none.
    """
    seeds = sorted(variant.trainings.keys() & reference.trainings.keys())
    if len(seeds) < MIN_SEEDS or len({deal for _, deal in seeds}) > 1:
        return {"seeds_low": "", "seeds_high": ""}
    errors = [np.array([each.errors(protocol, {seed})[0] for seed in seeds]) for each in (variant, reference)]
    more = 100 * (errors[0] - errors[1])
    half = float(student.ppf(0.975, len(more) - 1) * more.std(ddof=1) / len(more) ** 0.5)
    return {"seeds_low": float(more.mean()) - half, "seeds_high": float(more.mean()) + half}


def _percent(values: np.ndarray, groups: np.ndarray, rng: np.random.Generator, interval=group_interval) -> tuple:
    """Mean of values (n,) and its interval, in per cent; an interval needs two groups."""
    ends = interval(values, groups, rng)
    return 100 * float(values.mean()), *((100 * end for end in ends) if ends else ("", ""))


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


def power(rows: list[dict[str, Any]], groups: int) -> str:
    """A sentence on the smallest difference that could have been seen: half of the widest interval of each kind."""
    protocol, widest = rows[-1]["protocol"], {}
    for weighting in WEIGHTINGS:
        chosen = [row for row in rows if (row["protocol"], row["weighting"]) == (protocol, weighting)]
        compared = [each for row in chosen for each in row["versus"].values() if each["low"] != ""]
        widths = [(each["high"] - each["low"]) / 2 for each in compared]
        widest |= {f"per {weighting}": max(widths)} if widths else {}
        of_seeds = [each for each in compared if each["seeds_low"] != ""]
        if of_seeds:
            widest["over trainings"] = max((each["seeds_high"] - each["seeds_low"]) / 2 for each in of_seeds)
    if not widest:
        return "Nothing is compared in pairs here, so no smallest difference can be stated."
    if not max(widest.values()):
        return "What is compared here answered alike, so no smallest difference can be stated."
    verdict = (
        f"below {ENOUGH:g} points: where it shows no difference, there is no larger one"
        if max(widest.values()) < ENOUGH
        else f"above {ENOUGH:g} points: where it shows no difference there may be one, and it needs more data"
    )
    points = ", ".join(f"{width:.1f} points {of}" for of, width in widest.items())
    return (
        f"The smallest difference that this study could have seen is {points} ({protocol} protocol, half of the "
        f"widest paired interval, {groups} split groups), {verdict}."
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
