"""The trainings of all seeds put together: errors with their intervals beside what they cost, and the picture."""

import json
from collections.abc import Iterable
from pathlib import Path

import click
import numpy as np

from stages.command import INPUT, OUTPUT, stage
from studies.error_time.picture import picture
from studies.results import named, write_table
from tactile_viewgcn.files import readable, whole
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.statistics import group_interval, share_interval

COSTS = ("pretrain", "finetune", "single_ms", "batch_ms", "touches")
PAPER = {"time": "1", "views": "8", "width": "64", "reuse": "1", "precision": "float32"}
TEXT = """Error of the {side} side in per cent against what it costs; {seeds} training seeds. `low` and `high` are the
95 % interval that resamples the split groups, `spread` is the standard deviation over the seeds, `more` the paired
difference in points to the row of the same axis marked `reference`, with its interval, not corrected for how many rows
there are. `pretrain`, `finetune`: seconds of training; `single_ms`, `batch_ms`: milliseconds per view set alone and in
batches of 256; all medians over the seeds. Of V views V / `finetune.reuse`, rounded up, pass the backbone in
fine-tuning. Precision: the default's classifier, used in each. Touches: one classifier of any number of touches,
trained without the validation groups that it is calibrated on; its touches are frames of one recording at random."""


@stage("seed", "data")
@click.option("--trainings", "folder", type=INPUT, required=True, help="Folder of an .npz of each seed.")
@click.option("--side", type=click.Choice(["test", "validation"]), required=True, help="Where errors were measured.")
@click.option("--out", type=OUTPUT, required=True, help="Folder of results.csv, results.md and results.png.")
def table(params, run, folder, side, out):
    """Put the trainings of all seeds together."""
    paths, title = sorted(folder.glob("*.npz")), named(params.data)
    rows = together(paths, stream(params.seed, "error_time"))
    write_table(out, rows, f"{title}\n\n" + TEXT.format(side=side, seeds=len(paths)))
    with whole(out / "results.png") as part:
        picture(rows, f"{title}: error of the {side} side").savefig(part, format="png", dpi=110)
    for name in ("results.csv", "results.png"):
        run.artifact(out / name)
    print((out / "results.md").read_text(), end="")
    return {f"error.{row['axis']}.{row['protocol']}.{number}": row["error"] for number, row in enumerate(rows)}


def together(paths: Iterable[Path], rng: np.random.Generator) -> list[dict]:
    """A row for each setting and protocol: seeds averaged anchor by anchor before groups are resampled.

    Raises:
        ValueError: no seeds, or of other parameters, settings or anchors.
    """
    found, recipes = [], set()
    for path in paths:
        with readable(path), np.load(path) as content:
            found.append((json.loads(str(content["rows"])), content["right"], content["groups"]))
            recipes.add(str(content["recipe"]))
    if len(recipes) != 1:
        raise ValueError(
            f"{len(found)} seeds of {len(recipes)} different recipes; expected one recipe: delete what other runs left"
        )
    names, groups = [_name(row) for row in found[0][0]], found[0][2]
    for path, (rows, _, own) in zip(paths, found, strict=True):
        if [_name(row) for row in rows] != names or not np.array_equal(own, groups):
            raise ValueError(f"{path}: other settings or anchors than the first; train all seeds on the same frames")
    right = np.mean([right for _, right, _ in found], axis=0)  # (rows, A)
    spread = np.std([right.mean(axis=1) for _, right, _ in found], axis=0, ddof=1) if len(found) > 1 else None
    lines = []
    for number, (axis, value, protocol) in enumerate(names):
        costs = {cost: [rows[number][cost] for rows, _, _ in found if cost in rows[number]] for cost in COSTS}
        reference = names.index((axis, _reference(axis, names), protocol))
        error = _percent(1 - right[number], groups, rng, share_interval)
        more = _percent(right[reference] - right[number], groups, rng)
        lines.append(
            {"axis": axis, "value": value, "protocol": protocol}
            | dict(zip(("error", "low", "high"), error, strict=True))
            | {"spread": 100 * float(spread[number]) if spread is not None else ""}
            | dict(zip(("more", "more low", "more high"), more, strict=True))
            | {"reference": "reference" if number == reference else ""}
            | {cost: float(np.median(values)) if values else "" for cost, values in costs.items()}
        )
    return lines


def _name(row: dict) -> tuple[str, str, str]:
    return row["axis"], row["value"], row["protocol"]


def _reference(axis: str, names: list[tuple[str, str, str]]) -> str:
    """The row of an axis that the others are compared with, where it stands as in the paper."""
    values = [value for own, value, _ in names if own == axis]
    fixed = [value for value in values if value.startswith("fixed")]
    return fixed[-1] if fixed else PAPER[axis]


def _percent(values: np.ndarray, groups: np.ndarray, rng: np.random.Generator, interval=group_interval) -> tuple:
    """Mean of values (A,) and its interval, in per cent."""
    ends = interval(values, groups, rng)
    return 100 * float(values.mean()), *((100 * end for end in ends) if ends else ("", ""))


if __name__ == "__main__":
    table()
