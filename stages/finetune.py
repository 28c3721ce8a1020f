"""Train the classifier that model.system names: a network, from the pretrained backbone, or members on the sensors."""

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
    params, compute = job.params, job.compute()
    table, clusters = load_table(frames, Frames), load_table(views, Views)
    pretrained = {}
    if not on_sensors(params.model.system):
        with readable(backbone):
            pretrained = torch.load(backbone, map_location="cpu", weights_only=True)
    key = job.checkpoint_key()
    checkpoint_path = job.afterwards.enter_context(training_checkpoint("finetune", key, compute))
    fitted = fit_classifier(
        table, clusters, pretrained, params, compute, checkpoint_path, job.epoch
    )
    save_classifier(
        out, fitted.classifier, fitted.model, table, compute.precision, fitted.temperature
    )
    for note in fitted.notes:
        job.note(note)
    # of the processes before an interruption; this one's are added
    job.record.seconds = fitted.progress.resumed[1]
    classifier = fitted.classifier
    head = classifier.head.parameters() if isinstance(classifier, ViewNetwork) else ()
    job.record.counts["weights.head"] = sum(weight.numel() for weight in head)
    if on_sensors(params.model.system):
        members = " + ".join(fitted.model.members)
        job.record.counts["resolved.model.members"] = members
        return f"finetune: {members} fitted in {fitted.progress.seconds:.1f} s"
    if not fitted.progress.epoch:
        return f"finetune: {params.model.system} is not fine-tuned"
    job.record.counts["loss.first"] = fitted.progress.first_loss  # before a step: that of guessing
    return f"finetune: {fitted.progress} on {compute.device} in {compute.precision}"


if __name__ == "__main__":
    run(finetune, "frames", "views", "backbone")
