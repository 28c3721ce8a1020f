"""Train the classifier that model.system names.

The classifier is a network, fine-tuned from the pretrained backbone, or consists of members on the
sensors.
"""

from pathlib import Path

import torch

from stages.command import run
from stages.job import Job
from tactile_viewgcn.files import readable
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.params import on_sensors
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.tables.frames import Frames, Views, load_table
from tactile_viewgcn.training.checkpoint import training_checkpoint


def finetune(job: Job, frames: Path, views: Path, backbone: Path, out: Path) -> str:
    """Write the classifier, and return the line to print."""
    params = job.params
    compute = job.compute()
    table = load_table(frames, Frames)
    clusters = load_table(views, Views)
    pretrained = {}
    if not on_sensors(params.model.system):
        with readable(backbone):
            pretrained = torch.load(backbone, map_location="cpu", weights_only=True)
    checkpoint = training_checkpoint("finetune", job.checkpoint_key(), compute)
    checkpoint_path = job.afterwards.enter_context(checkpoint)
    fitted = fit_classifier(
        table, clusters, pretrained, params, compute, checkpoint_path, job.epoch
    )
    classifier = fitted.classifier
    save_classifier(out, classifier, fitted.model, table, compute.precision, fitted.temperature)
    for note in fitted.notes:
        job.note(note)
    # seconds of the processes before an interruption; the seconds of this process are added
    job.record.seconds = fitted.progress.resumed[1]
    job.record.counts["weights.head"] = 0
    if isinstance(classifier, ViewNetwork):
        job.record.counts["weights.head"] = sum(w.numel() for w in classifier.head.parameters())
    if on_sensors(params.model.system):
        members = " + ".join(fitted.model.members)
        job.record.counts["resolved.model.members"] = members
        return f"finetune: {members} fitted in {fitted.progress.seconds:.1f} s"
    if not fitted.progress.epoch:
        return f"finetune: {params.model.system} is not fine-tuned"
    # the loss before the first step, of a network that has learnt nothing
    job.record.counts["loss.first"] = fitted.progress.first_loss
    return f"finetune: {fitted.progress} on {compute.device} in {compute.precision}"


if __name__ == "__main__":
    run(finetune, "frames", "views", "backbone")
