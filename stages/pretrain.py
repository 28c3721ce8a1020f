"""Train the modified ResNet-18 from scratch to tell objects by single frames."""

import click
import torch

from stages.command import INPUT, OUTPUT, stage
from tactile_viewgcn.checkpoint import kept
from tactile_viewgcn.compute import choose, keep_freed_memory
from tactile_viewgcn.files import whole
from tactile_viewgcn.frames import read_frames
from tactile_viewgcn.pretraining import pretrain_backbone


@stage("seed", "device", "precision", "augment", "model.backbone", "pretrain")
@click.option("--frames", type=INPUT, required=True)
@click.option("--out", type=OUTPUT, required=True)
def pretrain(params, run, frames, out):
    """Train the modified ResNet-18 from scratch to tell objects by single frames."""
    keep_freed_memory()
    compute, table = choose(params.device, params.precision), read_frames(frames)
    run.tags({"device": compute.device, "precision": compute.precision})
    with kept("pretrain", params, run.md5s, compute) as keep:
        backbone, classifier, progress = pretrain_backbone(table, params, compute, keep)
        with whole(out) as part:
            torch.save(
                {
                    "backbone": backbone.cpu().state_dict(),
                    "classifier": classifier.cpu().state_dict(),
                    "classes": table.classes,
                },
                part,
            )
    run.curves(progress.curves, picture="pretrain_curves.png")
    print(f"pretrain: {progress} on {compute.device} in {compute.precision}")
    return {
        "weights": sum(weight.numel() for weight in backbone.parameters()),
    } | progress.metrics


if __name__ == "__main__":
    pretrain()
