"""Train Tactile-ViewGCN, or another system, on view sets, from the pretrained backbone."""

from pathlib import Path

import torch

from stages.command import Job, run
from tactile_viewgcn.files import readable
from tactile_viewgcn.nn.network import ViewNetwork, count_weights
from tactile_viewgcn.params import on_sensors
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.tables.frames import Views, load_table, read_frames
from tactile_viewgcn.training.checkpoint import training_checkpoint


def finetune(job: Job, frames: Path, views: Path, backbone: Path, out: Path) -> str:
    params, table, clusters, compute = job.params, read_frames(frames), load_table(views, Views), job.compute()
    alone, pretrained = on_sensors(params.model.system), {}
    if not alone:
        with readable(backbone):
            pretrained = torch.load(backbone, map_location="cpu", weights_only=True)
    key = job.checkpoint_key()
    with training_checkpoint("finetune", key, compute) as checkpoint_path:
        fitted = fit_classifier(table, clusters, pretrained, params, compute, checkpoint_path, job.epoch)
        save_classifier(out, fitted.classifier, fitted.model, table, compute.precision, fitted.temperature)
    for note in fitted.notes:
        job.note(note)
    classifier, progress = fitted.classifier, fitted.progress
    job.counts = {"weights.head": 0, "seconds_before_interruption": progress.resumed[1]}
    line = f"{params.model.system} is not fine-tuned"
    if alone:
        job.counts["resolved.model.members"] = " + ".join(fitted.model.members)
        line = f"{job.counts['resolved.model.members']} fitted in {progress.seconds:.1f} s"
    if isinstance(classifier, ViewNetwork):
        job.counts["weights.head"] = count_weights(classifier.head)
        if classifier.head.trainable:
            line = f"{progress} on {compute.device} in {compute.precision}"
    return f"finetune: {line}"


if __name__ == "__main__":
    run(finetune, "frames", "views", "backbone")
