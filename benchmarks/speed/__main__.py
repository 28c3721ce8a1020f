"""What the fast paths of the pipeline gain over plain ones, beside the machine's limits."""

from contextlib import redirect_stderr
from functools import partial
from io import StringIO
from pathlib import Path

import click
import torch
from tactile_viewgcn.markdown_tables import markdown

from benchmarks.command import Result, benchmark
from benchmarks.speed import measurements, plain
from benchmarks.speed.agreement import WITHIN, agreement
from benchmarks.speed.operators import operator_rows
from benchmarks.speed.recipe import recipe_rows
from benchmarks.speed.sample import take_sample
from tactile_viewgcn.device import Compute, keep_freed_memory, select_device
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.params import Params
from tactile_viewgcn.process import processor
from tactile_viewgcn.tables.frames import read_frames

MEASUREMENTS = (
    partial(measurements.time_step, batch=160),
    partial(measurements.time_step, batch=32),
    measurements.time_finetuning,
    measurements.time_evaluation,
    measurements.time_views,
)
FULL, QUICK = {"per_class": 24, "rounds": 3}, {"per_class": 12, "rounds": 1}
TEXT = f"""# What the fast paths gain

{{machine}}.

One network of a short training on the same view sets, against plain float32: `difference` is what the logits of
{WITHIN:.0%} of the view sets stay within, as a share of the largest logit, and `largest` that of all view sets.

{{agreement}}

The paper's recipe on STAG's size, 30 epochs of pretraining and 15 of fine-tuning on 36,531 anchors and ten trials of
two protocols on 16,119, not run but multiplied out from the rates below, against the released design: plain float32,
batches of 32 frames and of 20 view sets, every view of every view set through the backbone in every trial.

{{recipe}}

A training step of the backbone, batch 32, by its operators. Profiling makes a step slower; the shares are what counts.

{{operators}}

Medians of interleaved rounds: `fast` is the rate of the pipeline, `counterpart` that of what it is compared `against`,
and `ratio` how many times as fast the pipeline is (median of the rounds' ratios), below 1 against a limit."""


@benchmark
@click.option("--frames", type=click.Path(exists=True, path_type=Path), default="data/frames.h5", show_default=True)
def speed(params: Params, quick: bool, frames: Path) -> Result:
    """Time each fast path and its plain counterpart, round by round, and see that they agree.

    Reads the frames of `dvc repro preprocess`. Takes up to ten minutes on two cores; --quick is one round on less data.
    """
    keep_freed_memory()
    system, kind = params.model.system, params.model.backbone.kind
    if (system, kind) != ("view_gcn", "resnet"):
        raise UserError(
            f"model.system and backbone.kind are {system} and {kind}; expected view_gcn and resnet, which alone have "
            "plain counterparts: change params.yaml"
        )
    compute = select_device(params.device, params.precision)
    with redirect_stderr(StringIO()):  # the progress of trainings that are run many times
        sample = take_sample(read_frames(frames), params, compute, **(QUICK if quick else FULL))
        agreed = agreement(sample)
        rows = [row for measurement in MEASUREMENTS for row in measurement(sample)]
        operators = "None on a graphics card, which repeats its kernels as one graph."
        if compute.device.type == "cpu":
            slow = plain.plain_backbone(sample.classifier.backbone)
            operators = markdown(operator_rows(measurements.training_steps(sample, slow, batch=32)))
    tables = {"agreement": markdown(agreed), "recipe": markdown(recipe_rows(rows)), "operators": operators}
    return TEXT.format(machine=machine(compute), **tables), rows, None


def machine(compute: Compute) -> str:
    """The processor and the graphics card in use, torch and its threads, and the precision of the fast path."""
    devices = [processor(), *([torch.cuda.get_device_name()] if compute.device.type == "cuda" else [])]
    threads, precision = torch.get_num_threads(), compute.precision
    return f"{', '.join(devices)}, torch {torch.__version__} with {threads} threads; fast path in {precision}"


if __name__ == "__main__":
    speed()
