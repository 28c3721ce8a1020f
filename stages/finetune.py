"""Train Tactile-ViewGCN, or another system, on view sets, from the pretrained backbone."""

import click
import torch

from stages.command import INPUT, OUTPUT, stage
from tactile_viewgcn.checkpoint import kept
from tactile_viewgcn.classifier import save_classifier, system_of, weights_of
from tactile_viewgcn.compute import choose, keep_freed_memory
from tactile_viewgcn.files import readable
from tactile_viewgcn.finetuning import finetune_classifier
from tactile_viewgcn.frames import read_frames
from tactile_viewgcn.split import VALIDATION
from tactile_viewgcn.touches import HOTTEST, calibrate
from tactile_viewgcn.views import read_views


@stage("seed", "device", "precision", "cluster", "augment", "model", "finetune")
@click.option("--frames", type=INPUT, required=True)
@click.option("--views", type=INPUT, required=True)
@click.option("--backbone", type=INPUT, required=True)
@click.option("--out", type=OUTPUT, required=True)
def finetune(params, run, frames, views, backbone, out):
    """Train Tactile-ViewGCN, or another system, on view sets, from the pretrained backbone."""
    keep_freed_memory()
    compute, table = choose(params.device, params.precision), read_frames(frames)
    run.tags({"device": compute.device, "precision": compute.precision})
    with readable(backbone):
        pretrained = torch.load(backbone, map_location="cpu", weights_only=True)
    found, learns = read_views(views), system_of(params.model.system).learns  # its code is loaded: `kept` asks for that
    calibrated = params.finetune.sizes == "random" and bool((table.anchor & (table.side == VALIDATION)).any())
    with kept("finetune", params, run.md5s, compute) as keep:
        classifier, progress = finetune_classifier(table, found, pretrained, params, compute, keep)
        temperatures = calibrate(classifier, table, compute, params.seed) if calibrated else None
        save_classifier(out, classifier, params.model, table, compute.precision, temperatures)
    if temperatures and max(temperatures) > 0.9 * HOTTEST:
        print("  on the validation groups its answers are no better than chance: no evaluate.stop_at will be reached")
    if not learns:
        print(f"finetune: {params.model.system} has nothing to learn and takes what pretraining found")
        return {"weights.head": weights_of(classifier.head)}
    run.curves(progress.curves, picture="finetune_curves.png")
    print(f"finetune: {progress} on {compute.device} in {compute.precision}")
    return {"weights.head": weights_of(classifier.head)} | progress.metrics


if __name__ == "__main__":
    finetune()
