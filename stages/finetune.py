"""Train Tactile-ViewGCN, or another system, on view sets, from the pretrained backbone."""

from pathlib import Path
from typing import Any

import click
import torch

from stages.command import PATH, options, started
from tactile_viewgcn.device import keep_freed_memory, select_device
from tactile_viewgcn.files import readable
from tactile_viewgcn.frames.noise_check import noise_warnings
from tactile_viewgcn.nn.network import ViewNetwork, count_weights
from tactile_viewgcn.process import rank
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.systems import on_sensors
from tactile_viewgcn.tables.frames import read_frames
from tactile_viewgcn.tables.views import read_views
from tactile_viewgcn.training.checkpoint import training_checkpoint
from tactile_viewgcn.training.distributed import process_group


@click.command(help=__doc__)
@options
@click.option("--frames", type=PATH, required=True)
@click.option("--views", type=PATH, required=True)
@click.option("--backbone", type=PATH, required=True)
@click.option("--out", type=PATH, required=True)
def finetune(frames: Path, views: Path, backbone: Path, out: Path, **common: Any) -> None:
    inputs = {"frames": frames, "views": views, "backbone": backbone}
    with started("finetune", inputs, **common) as job:
        keep_freed_memory()
        params, table, clusters, pretrained = job.params, read_frames(frames), read_views(views), {}
        compute, job.epochs = select_device(params.device, params.precision), params.finetune.epochs
        job.computed_on(compute)
        alone = on_sensors(params.model.system)  # one process fits it
        if alone and rank():
            return
        if not alone:
            with readable(backbone):
                pretrained = torch.load(backbone, map_location="cpu", weights_only=True)
            for note in noise_warnings(table, params.finetune.noise):
                job.note(note)
        key = job.checkpoint_key()
        with process_group(compute, alone), training_checkpoint("finetune", key, compute) as checkpoint_path:
            fitted = fit_classifier(table, clusters, pretrained, params, compute, checkpoint_path, job.epoch)
            if rank():
                return
            save_classifier(out, fitted.classifier, fitted.model, table, compute.precision, fitted.calibration)
        for note in fitted.notes:
            job.note(note)
        classifier, progress = fitted.classifier, fitted.progress
        trained = isinstance(classifier, ViewNetwork) and classifier.head.trainable
        weights = count_weights(classifier.head) if isinstance(classifier, ViewNetwork) else 0
        if trained:
            line = f"{progress} on {compute.device} in {compute.precision}"
        else:
            how = f"fitted in {progress.seconds:.1f} s" if alone else "not fine-tuned"
            line = f"{params.model.system} is {how}"
        click.echo(f"finetune: {line}")
        job.counts = {"weights.head": weights} | progress.metrics


if __name__ == "__main__":
    finetune()
