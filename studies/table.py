"""The arms of a study put together: error with its interval, paired differences to one of them, and costs."""

from collections.abc import Iterable
from dataclasses import dataclass

import click
import numpy as np

from stages.command import INPUT, OUTPUT, stage
from studies.arms import Arm, read_arms
from studies.results import write_table
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.statistics import group_interval, holm, sign_flip

VIRTUAL, SIMULATED = "data/virtual/recordings", "Simulated by the virtual glove"
EXPLAINED = """Error in per cent on the {side} side: the mean over seeds and trials; {groups} split groups. `low` and
`high` are the 95 % interval that resamples these groups, conditional on the trainings; `training sd` is the standard
deviation over the training seeds, `clustering sd` over the trials."""
COMPARED = """`more` is the paired difference in points to {reference}, with its interval, and
`p` says how often groups with signs turned at random differ as much, corrected for the number of rows of a protocol
(Holm)."""
COSTS = {
    "weights": "weights",
    "pretrain s": "pretrain",
    "finetune s": "finetune",
    "ms alone": "single_ms",
    "ms in batches": "batch_ms",
    "peak MB": "peak_mb",
}
PAID = """`weights` with the backbone's; seconds of the two trainings, summed over folds; milliseconds per
view set alone and in batches of 256; memory of the process that fine-tunes and tests. Medians over the seeds."""


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
    source = SIMULATED if params.data.source == VIRTUAL else params.data.source
    arms = pooled(read_arms(folders))
    rows = rows_of(arms, reference, stream(params.seed, f"study.{study}"))
    groups = len(np.unique(arms[0].groups))
    text = [f"{source}. {asks}", EXPLAINED.format(side=side, groups=groups if reference else "the arm's own")]
    text += [COMPARED.format(reference=f"`{reference}`")] if reference else []
    write_table(out, rows, "\n\n".join([*text, PAID]), name=name)
    for kind in ("csv", "md"):
        run.artifact(out / f"{name}.{kind}")
    print((out / f"{name}.md").read_text(), end="")
    return {f"error.{row['arm']}.{row['protocol']}".replace(" ", "_"): row["error"] for row in rows}


@dataclass(frozen=True)
class Pooled:
    """All trainings of one arm, the test sides of its folds side by side.

    Attributes:
        name: of the arm; seeds: how many.
        predicted: by protocol, (S, T, A); labels, groups: (A,).
        costs: of each seed, {name: value}.
    """

    name: str
    predicted: dict[str, np.ndarray]
    labels: np.ndarray
    groups: np.ndarray
    costs: list[dict[str, float]]
    classes: list[str]

    @property
    def seeds(self) -> int:
        return len(self.costs)

    def right(self, protocol: str) -> np.ndarray:
        """bool (S, T, A)."""
        return self.predicted[protocol] == self.labels

    def error(self, protocol: str) -> float:
        return 1 - float(self.right(protocol).mean())


def pooled(arms: Iterable[Arm]) -> list[Pooled]:
    """One for each name, in the order of their appearance.

    Raises:
        ValueError: a seed lacks a fold that another has, or was tested on other anchors.
    """
    by_name: dict[str, dict[int, dict[int, Arm]]] = {}
    for arm in arms:
        by_name.setdefault(arm.name, {}).setdefault(arm.seed, {})[arm.fold] = arm
    found = []
    for name, seeds in by_name.items():
        first = next(iter(seeds.values()))
        for seed, folds in seeds.items():
            same = folds.keys() == first.keys() and all(
                np.array_equal(folds[fold].groups, first[fold].groups) for fold in folds
            )
            if not same:
                raise ValueError(f"arm {name}: seed {seed} has other folds or anchors than another seed: train it anew")
        order = sorted(first)
        found.append(
            Pooled(
                name,
                {
                    protocol: np.stack(
                        [
                            np.concatenate([s[fold].predicted[protocol] for fold in order], axis=1)
                            for s in seeds.values()
                        ]
                    )
                    for protocol in first[order[0]].predicted
                },
                np.concatenate([first[fold].labels for fold in order]),
                np.concatenate([first[fold].groups for fold in order]),
                [_costs([folds[fold] for fold in order]) for folds in seeds.values()],
                first[order[0]].classes,
            )
        )
    return found


def _costs(folds: list[Arm]) -> dict[str, float]:
    """Seconds summed over the folds, everything else as in the hungriest."""
    names = folds[0].costs
    return {
        name: (sum if name in ("pretrain", "finetune") else max)(fold.costs[name] for fold in folds) for name in names
    }


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
    row = {"arm": arm.name, "protocol": protocol, "seeds": arm.seeds}
    row |= dict(zip(("error", "low", "high"), _percent(1 - right.mean(axis=(0, 1)), arm.groups, rng), strict=True))
    row["training sd"] = 100 * float(right.mean(axis=(1, 2)).std(ddof=1)) if arm.seeds > 1 else ""
    row["clustering sd"] = 100 * float(right.mean(axis=2).std(axis=1, ddof=1).mean()) if right.shape[1] > 1 else ""
    if against is not None:
        if not (np.array_equal(arm.groups, against.groups) and np.array_equal(arm.labels, against.labels)):
            raise ValueError(f"arm {arm.name} was tested on other anchors than {against.name}: train both anew")
        more = against.right(protocol).mean(axis=(0, 1)) - right.mean(axis=(0, 1))
        itself = arm is against
        ends = ("", "", "") if itself else _percent(more, arm.groups, rng)
        row |= dict(zip(("more", "more low", "more high"), ends, strict=True))
        row["p"] = "" if itself else sign_flip(more, arm.groups, rng)
    known = {title: [cost[name] for cost in arm.costs if name in cost] for title, name in COSTS.items()}
    return row | {title: float(np.median(values)) if values else "" for title, values in known.items()}


def _percent(values: np.ndarray, groups: np.ndarray, rng: np.random.Generator) -> tuple:
    """Mean of values (A,) and its interval, in per cent; an interval needs two groups."""
    interval = group_interval(values, groups, rng)
    return 100 * float(values.mean()), *((100 * end for end in interval) if interval else ("", ""))


if __name__ == "__main__":
    table()
