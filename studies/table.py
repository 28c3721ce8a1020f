"""The arms of a study put together: error with its interval, paired differences to one of them, and costs."""

import re

import click
import numpy as np

from stages.command import INPUT, OUTPUT, stage
from studies.arms import read_arms
from studies.differences import holm, sign_flip
from studies.pooling import Pooled, pooled
from studies.results import named, write_table
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.statistics import group_interval, share_interval

EXPLAINED = """{sets:,} view sets, {classes} classes, {trials} trials, {groups} split groups. Error in per cent on
the {side} side: the mean over trainings and trials.
`low` and `high` are the 95 % interval that resamples these groups, conditional on the trainings; under `object`, where
a view set mixes an object's recordings, it is optimistic. `repeat sd` is the standard deviation over the trainings of
an arm, which differ in their seed or in what the arm's name says; `clustering sd` that over trials. Where `trainings`
is 1, all that is said is said of one trained network."""
COMPARED = """`more` is the paired difference in points to {reference}, over the seeds that both were trained from,
with its interval; `p` says how often groups with their signs turned differ as much, corrected for the number of rows
of a protocol (Holm). With {groups} groups it is never below {least:.2g} before that."""
COSTS = {
    "weights": "weights",
    "pretrain s": "pretrain",
    "finetune s": "finetune",
    "ms alone": "single_ms",
    "ms in batches": "batch_ms",
    "peak MB": "peak_mb",
}
PAID = """`weights` with the backbone's; seconds of the two trainings, summed over folds; milliseconds per
view set alone and in batches of 256; memory of the process that fine-tunes and tests. Medians over the trainings."""


@stage("seed", "data")
@click.option("--study", required=True, help="Its name.")
@click.option("--asks", required=True, help="The question that it answers.")
@click.option("--arms", "folders", type=INPUT, required=True, multiple=True, help="Folder of trained arms.")
@click.option("--reference", help="The arm that the others are compared with.")
@click.option("--side", type=click.Choice(["test", "validation"]), default="test", help="Where errors were measured.")
@click.option("--name", default="results", show_default=True, help="Of the two files.")
@click.option("--out", type=OUTPUT, required=True, help="Their folder.")
def table(params, run, study, asks, folders, reference, side, name, out):
    """Put the arms of a study together."""
    arms = pooled(read_arms(folders))
    rows = rows_of(arms, reference, stream(params.seed, f"study.{study}"))
    groups = len(np.unique(arms[0].groups))
    trials = len(next(iter(arms[0].predicted.values()))[0])
    size = {"sets": len(arms[0].labels), "classes": len(arms[0].classes), "trials": trials}
    size["groups"] = groups if reference else "each arm's own"
    text = [f"{named(params.data)}. {asks}", EXPLAINED.format(side=side, **size)]
    if reference:
        text.append(COMPARED.format(reference=f"`{reference}`", groups=groups, least=max(2.0**-groups * 2, 1e-4)))
    write_table(out, rows, "\n\n".join([*text, PAID]), name=name)
    for kind in ("csv", "md"):
        run.artifact(out / f"{name}.{kind}")
    print((out / f"{name}.md").read_text(), end="")
    return {re.sub(r"[^\w./-]+", "_", f"error.{row['arm']}.{row['protocol']}"): row["error"] for row in rows}


def rows_of(arms: list[Pooled], reference: str | None, rng: np.random.Generator) -> list[dict]:
    """A row for each arm and protocol.

    Raises:
        ValueError: no such reference, or an arm was tested on other anchors than it.
    """
    against = next((arm for arm in arms if arm.name == reference), None)
    if reference and against is None:
        raise ValueError(f"no arm is called {reference}; there are {', '.join(arm.name for arm in arms)}")
    rows = []
    for protocol in arms[0].predicted:
        own = [_row(arm, against, protocol, rng) for arm in arms]
        compared = [row for row in own if row.get("p", "") != ""]
        for row, p in zip(compared, holm([row["p"] for row in compared]), strict=True):
            row["p"] = p
        rows += own
    return rows


def _row(arm: Pooled, against: Pooled | None, protocol: str, rng: np.random.Generator) -> dict:
    right = arm.right(protocol)
    row = {"arm": arm.name, "protocol": protocol, "trainings": len(arm.seeds)}
    wrong = _percent(1 - right.mean(axis=(0, 1)), arm.groups, rng, share_interval)
    row |= dict(zip(("error", "low", "high"), wrong, strict=True))
    row["repeat sd"] = 100 * float(right.mean(axis=(1, 2)).std(ddof=1)) if len(arm.seeds) > 1 else ""
    row["clustering sd"] = 100 * float(right.mean(axis=2).std(axis=1, ddof=1).mean()) if right.shape[1] > 1 else ""
    if against is not None:
        row |= _compared(arm, against, protocol, rng)
    known = {title: [cost[name] for cost in arm.costs if name in cost] for title, name in COSTS.items()}
    return row | {title: float(np.median(values)) if values else "" for title, values in known.items()}


def _compared(arm: Pooled, against: Pooled, protocol: str, rng: np.random.Generator) -> dict:
    """The paired difference over common seeds; blank for the reference itself, or where no seed is common."""
    if not (np.array_equal(arm.groups, against.groups) and np.array_equal(arm.labels, against.labels)):
        raise ValueError(f"arm {arm.name} was tested on other anchors than {against.name}: train both anew")
    common = sorted(set(arm.seeds) & set(against.seeds))
    if arm is against or not common:
        return {"more": "", "more low": "", "more high": "", "p": ""}
    more = np.mean([_of_seed(against, protocol, seed) - _of_seed(arm, protocol, seed) for seed in common], axis=0)
    ends = dict(zip(("more", "more low", "more high"), _percent(more, arm.groups, rng), strict=True))
    return ends | {"p": sign_flip(more, arm.groups, rng)}


def _of_seed(arm: Pooled, protocol: str, seed: int) -> np.ndarray:
    """(A,) share of right answers in the trainings of a seed."""
    return arm.right(protocol)[np.array(arm.seeds) == seed].mean(axis=(0, 1))


def _percent(values: np.ndarray, groups: np.ndarray, rng: np.random.Generator, interval=group_interval) -> tuple:
    """Mean of values (A,) and its interval, in per cent; an interval needs two groups."""
    ends = interval(values, groups, rng)
    return 100 * float(values.mean()), *((100 * end for end in ends) if ends else ("", ""))


if __name__ == "__main__":
    table()
