"""Train the modified ResNet-18 from scratch to recognise objects from single frames."""

from pathlib import Path

from stages.command import run
from stages.job import Job
from tactile_viewgcn.files import write_file
from tactile_viewgcn.tables.frames import Frames, load_table

LEFT_OUT = "pretrain: left out, model.system does not need it"


def pretrain(job: Job, needs: Path, frames: Path, out: Path) -> str:
    """Write the backbone and its classifier, and return the line to print."""
    if not job.needed:
        write_file(out, f"{LEFT_OUT}\n")
        return LEFT_OUT
    # imported here, so that a stage that is left out does not load torch
    from tactile_viewgcn.training.checkpoint import training_checkpoint, write_tensors
    from tactile_viewgcn.training.pretraining import pretrain_backbone

    table = load_table(frames, Frames)
    compute = job.compute()
    checkpoint = training_checkpoint("pretrain", job.checkpoint_key(), compute)
    checkpoint_path = job.afterwards.enter_context(checkpoint)
    backbone, classifier, progress = pretrain_backbone(
        table, job.params, compute, checkpoint_path, job.epoch
    )
    content = {
        "backbone": backbone.cpu().state_dict(),
        "classifier": classifier.cpu().state_dict(),
        "classes": table.classes,
    }
    write_tensors(out, content)
    job.record.counts["weights.backbone"] = sum(weight.numel() for weight in backbone.parameters())
    if progress.epoch:
        # the loss before the first step, of a network that has learnt nothing
        job.record.counts["loss.first"] = progress.first_loss
    job.record.seconds = progress.resumed[1]  # of the processes before an interruption
    return f"pretrain: {progress} on {compute.device} in {compute.precision}"


if __name__ == "__main__":
    run(pretrain, "needs", "frames")
