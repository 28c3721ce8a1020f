"""What the fast paths of the pipeline gain over plain ones, in one run, beside the machine's limits."""

import csv
import re

import click

from stages.command import INPUT, OUTPUT, stage
from studies.results import write_table
from studies.speed import pairs, report, rows
from studies.speed.agreement import agreement
from studies.speed.sample import sample
from studies.speed.steps import steps
from tactile_viewgcn.compute import choose, keep_freed_memory
from tactile_viewgcn.files import whole
from tactile_viewgcn.frames import read_frames

REUSES = (1, 2, 4, 8)
READS = (
    "seed", "views", "viewpoints", "device", "precision", "cluster", "augment", "pretrain", "model", "finetune",
    "evaluate",
)  # fmt: skip


@stage(*READS)
@click.option("--frames", type=INPUT, required=True)
@click.option("--out", type=OUTPUT, required=True, help="Folder of results.csv, results.md and agreement.csv.")
def speed(params, run, frames, out):
    """Time each fast path and its plain counterpart in turn, and see that they agree."""
    keep_freed_memory()
    if params.model.system != "view_gcn" or params.model.backbone.kind != "resnet":
        raise ValueError(
            f"model.system is {params.model.system} on a {params.model.backbone.kind}; the study has a plain "
            "counterpart of view_gcn on a resnet alone: set these"
        )
    compute = choose(params.device, params.precision)
    one = sample(read_frames(frames), params, compute)
    agreed = agreement(one, params, compute.device)
    taken = steps(one, params, compute)
    tuned = pairs.finetuning(one, params, compute, sorted({params.finetune.reuse, *REUSES}))
    evaluated, features = pairs.evaluation(one, params, compute), pairs.features(one, compute)
    found = [
        *rows.of_limits(taken, one, compute),
        *rows.of_steps(taken, one, compute),
        *rows.of_finetuning(tuned, one, params),
        *rows.of_evaluation(evaluated, features, one, params),
        rows.of_rate("drawing view sets", "training side", "view sets/s", pairs.drawing(one, params)),
        rows.of_time("ten clusterings", "training side, by object", "s", pairs.clustering(one, params)),
        rows.of_rate("ingest", f"metadata.mat of {pairs.INGESTED} frames", "frames/s", pairs.ingest(one.table)),
    ]
    whole_recipe = rows.of_recipe(taken, tuned, evaluated, features, one, params)
    with whole(out / "agreement.csv") as part, part.open("w", newline="") as file:
        writer = csv.DictWriter(file, agreed[0])
        writer.writeheader()
        writer.writerows(agreed)
    write_table(out, found, report.text(compute, agreed, whole_recipe))
    for name in ("results.csv", "agreement.csv"):
        run.artifact(out / name)
    print((out / "results.md").read_text(), end="")
    ratios = {f"{row['what']}.{row['size']}": row["ratio"] for row in found if row["ratio"] != ""}
    return {re.sub(r"[^\w.]+", "_", name): ratio for name, ratio in ratios.items()}


if __name__ == "__main__":
    speed()
