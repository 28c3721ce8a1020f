"""Train the modified ResNet-18 from scratch to tell objects by single frames."""

import click

from stages.command import INPUT, NEEDS, OUTPUT, stage
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.process import rank
from tactile_viewgcn.tables.frames import read_frames


@stage("seed", "device", "precision", "augment", "model.backbone", "pretrain", several=True)
@NEEDS
@click.option("--frames", type=INPUT, required=True)
@click.option("--out", type=OUTPUT, required=True)
def pretrain(params, job, frames, out):
    """Train the modified ResNet-18 from scratch to tell objects by single frames."""
    import torch  # here: where this stage is left out, nothing loads it

    from tactile_viewgcn.device import keep_freed_memory, select_device
    from tactile_viewgcn.training.checkpoint import training_checkpoint
    from tactile_viewgcn.training.distributed import process_group
    from tactile_viewgcn.training.pretraining import pretrain_backbone

    keep_freed_memory()
    compute, table = select_device(params.device, params.precision), read_frames(frames)
    job.computed_on(compute.device, compute.precision)
    with (
        process_group(compute),
        training_checkpoint("pretrain", params, job.md5s, compute) as checkpoint_path,
    ):
        on_epoch = job.on_epoch(params.pretrain.epochs)
        backbone, classifier, progress = pretrain_backbone(table, params, compute, checkpoint_path, on_epoch)
        if rank():
            return None
        with atomic_write(out) as part:
            torch.save(
                {
                    "backbone": backbone.cpu().state_dict(),
                    "classifier": classifier.cpu().state_dict(),
                    "classes": table.classes,
                },
                part,
            )
    print(f"pretrain: {progress} on {compute.device} in {compute.precision}")
    return {"weights.backbone": sum(weight.numel() for weight in backbone.parameters())} | progress.metrics


if __name__ == "__main__":
    pretrain()
