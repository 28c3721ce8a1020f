"""What the fast paths of the pipeline gain over plain ones."""

from contextlib import redirect_stderr
from functools import partial
from io import StringIO
from pathlib import Path

import click
import numpy as np
import torch

from benchmarks.command import Result, benchmark, markdown
from benchmarks.speed import measurements
from benchmarks.speed.plain import WITHIN, agreement
from benchmarks.speed.sample import Sample, anchors_of
from benchmarks.trained import CLASSIFIER, FRAMES, read_trained
from tactile_viewgcn.device import keep_freed_memory, select_device
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import Params
from tactile_viewgcn.process import processor
from tactile_viewgcn.tables.frames import TEST

MEASUREMENTS = (
    partial(measurements.time_step, batch=160),
    partial(measurements.time_step, batch=32),
    measurements.time_finetuning,
    measurements.time_evaluation,
)
#: passes and anchors of STAG's `classification`, the paper's numbers; evaluation is ten trials of two protocols
PRETRAINING, FINETUNING, EVALUATION = (30, 36_531), (15, 36_531), (20, 16_119)
TEXT = f"""# What the fast paths gain

{{machine}}, torch {torch.__version__} with {{threads}} threads; fast path in {{precision}}.

The trained network on the same view sets, against plain float32: `difference` is what the logits of
{WITHIN:.0%} of the view sets stay within, as a share of the largest logit, and `largest` that of all view sets.

{{agreement}}

The paper's recipe on STAG's size, 30 epochs of pretraining and 15 of fine-tuning on 36,531 anchors and ten trials of
two protocols on 16,119, not run but multiplied out from the rates below, against the released design: plain float32,
batches of 32 frames and of 20 view sets, every view of every view set through the backbone in every trial.

{{recipe}}

Medians of interleaved rounds: rates of the pipeline and of the plain counterpart, and how many times as fast the
pipeline is (median of the rounds' ratios)."""


@benchmark
@click.option("--frames", type=click.Path(path_type=Path), default=FRAMES, show_default=True)
@click.option("--classifier", type=click.Path(path_type=Path), default=CLASSIFIER, show_default=True)
def speed(params: Params, quick: bool, frames: Path, classifier: Path) -> Result:
    """Time each fast path and its plain counterpart, round by round, and see that they agree.

    Reads what `dvc repro` made. Takes up to ten minutes on two cores; --quick is one round on less data.
    """
    keep_freed_memory()
    trained, table, params = read_trained(frames, classifier, params)
    if params.model.system != "view_gcn":
        raise UserError(f"model.system is {params.model.system}; expected view_gcn, which alone has plain counterparts")
    compute = select_device(params.device, params.precision)
    small = anchors_of(table, 12 if quick else 24)
    sample = Sample(trained.to(compute.device), small, params, compute, 1 if quick else 3)
    with redirect_stderr(StringIO()):  # the progress of trainings that are run many times
        agreed = agreement(sample.classifier, sample.tensors(TEST)[0], sample.view_sets(TEST))
        rows = [row for measurement in MEASUREMENTS for row in measurement(sample)]
    cards = [torch.cuda.get_device_name()] if compute.device.type == "cuda" else []
    about = {"machine": ", ".join([processor(), *cards]), "precision": compute.precision}
    tables = {"agreement": markdown(agreed), "recipe": markdown(recipe_rows(rows))}
    return TEXT.format(threads=torch.get_num_threads(), **about, **tables), rows, None


def recipe_rows(rows: list[dict]) -> list[dict]:
    """Hours of each part of the paper's recipe and of all of it, from the rows of everything that was measured."""

    def hours(passes: int, anchors: int, row: dict) -> np.ndarray:
        """(2,) fast and plain."""
        return passes * anchors / np.array([row["fast"], row["plain"]]) / 3600

    (step,) = (row for row in rows if row["what"] == "training step" and row["size"] == "batch 32")
    (trials,) = (row for row in rows if row["what"] == "evaluation")
    pretraining, evaluation = hours(*PRETRAINING, step), hours(*EVALUATION, trials)
    parts = {"pretraining": pretraining, "evaluation": evaluation}
    for row in rows:
        if row["what"] == "fine-tuning":
            parts[f"fine-tuning, {row['size']}"] = finetuning = hours(*FINETUNING, row)
            parts[f"together, {row['size']}"] = pretraining + finetuning + evaluation
    return [
        {"part": part, "fast hours": fast, "plain hours": slow, "ratio": slow / fast}
        for part, (fast, slow) in parts.items()
    ]


if __name__ == "__main__":
    speed()
