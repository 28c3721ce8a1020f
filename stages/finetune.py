"""Train Tactile-ViewGCN, or another system, on view sets, from the pretrained backbone."""

import click
import torch

from stages.command import INPUT, OUTPUT, stage
from tactile_viewgcn.device import keep_freed_memory, select_device
from tactile_viewgcn.files import readable
from tactile_viewgcn.frames.noise_check import noise_warnings
from tactile_viewgcn.nn.network import count_weights
from tactile_viewgcn.process import rank
from tactile_viewgcn.recognition.calibration import calibration_warning, fit_temperatures
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.systems import system_class
from tactile_viewgcn.tables.frames import read_frames
from tactile_viewgcn.tables.views import read_views
from tactile_viewgcn.training.checkpoint import training_checkpoint
from tactile_viewgcn.training.distributed import process_group
from tactile_viewgcn.training.finetuning import finetune_classifier


@stage("seed", "device", "precision", "cluster.assignment", "augment", "model", "finetune", several=True)
@click.option("--frames", type=INPUT, required=True)
@click.option("--views", type=INPUT, required=True)
@click.option("--backbone", type=INPUT, required=True)
@click.option("--out", type=OUTPUT, required=True)
def finetune(params, job, frames, views, backbone, out):
    """Train Tactile-ViewGCN, or another system, on view sets, from the pretrained backbone."""
    keep_freed_memory()
    compute, table = select_device(params.device, params.precision), read_frames(frames)
    job.computed_on(compute.device, compute.precision)
    system, pretrained = system_class(params.model.system), {}
    alone = system.takes == "sensors"  # one process fits it
    if alone and rank():
        return None
    if not alone:
        with readable(backbone):
            pretrained = torch.load(backbone, map_location="cpu", weights_only=True)
        for warning in noise_warnings(table, params.finetune.noise):
            job.note(warning)
    clusters, on_epoch = read_views(views), job.on_epoch(params.finetune.epochs)
    with process_group(compute, alone), training_checkpoint("finetune", params, job.md5s, compute) as checkpoint_path:
        given = pretrained, params, compute
        classifier, progress = finetune_classifier(table, clusters, *given, checkpoint_path, on_epoch)
        if rank():
            return None
        calibration = fit_temperatures(
            classifier, lambda part: finetune_classifier(part, clusters, *given)[0], table, params, compute
        )
        save_classifier(out, classifier, params.model, table, compute.precision, calibration)
    if warning := calibration_warning(classifier, calibration):
        job.note(warning)
    trained = f"{progress} on {compute.device} in {compute.precision}"
    fitted = f"is fitted in {progress.seconds:.1f} s" if progress.seconds else "is not fine-tuned"
    print(f"finetune: {trained if system.trainable else f'{params.model.system} {fitted}'}")
    return {"weights.head": count_weights(classifier.head)} | progress.metrics


if __name__ == "__main__":
    finetune()
