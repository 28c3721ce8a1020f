"""One arm of a study: cluster, fine-tune from a pretrained backbone, test in all trials."""

import json
from dataclasses import replace

import click
import torch

from stages.command import INPUT, OUTPUT, peak_mb, stage
from studies.arms import Arm, recipe_of, write_arm
from tactile_viewgcn.checkpoint import kept
from tactile_viewgcn.classifier import system_of, weights_of
from tactile_viewgcn.clustering import cluster_table
from tactile_viewgcn.compute import choose, keep_freed_memory
from tactile_viewgcn.evaluation import evaluate_table
from tactile_viewgcn.files import readable
from tactile_viewgcn.finetuning import finetune_classifier
from tactile_viewgcn.frames import read_frames
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.viewpoints import viewpoints


@stage("seed", "views", "viewpoints", "device", "precision", "cluster", "augment", "model", "finetune", "evaluate")
@click.option("--study", required=True)
@click.option("--arm", required=True, help="What is varied.")
@click.option("--fold", type=int, default=0, help="Of the split that the frames are of.")
@click.option("--clustering", type=int, help="Seed of the training side's clusters, if not `seed`.")
@click.option("--timed", is_flag=True, help="Measure the latency too.")
@click.option("--frames", type=INPUT, required=True)
@click.option("--backbone", type=INPUT, required=True)
@click.option("--pretrained", type=INPUT, required=True, help="Record of the backbone's pretraining.")
@click.option("--out", type=OUTPUT, required=True, help="An .npz of every answer.")
def train(params, run, study, arm, fold, clustering, timed, frames, backbone, pretrained, out):
    """Cluster, fine-tune and test one arm of a study."""
    keep_freed_memory()
    compute, table = choose(params.device, params.precision), read_frames(frames)
    run.tags({"study": study, "arm": arm, "fold": fold, "device": compute.device, "precision": compute.precision})
    with readable(backbone):
        weights = torch.load(backbone, map_location="cpu", weights_only=True)
    places = viewpoints(params.views, params.viewpoints, params.seed)
    rng = stream(params.seed if clustering is None else clustering, "cluster")
    views = cluster_table(table, places, params.cluster, rng)
    system_of(params.model.system)  # its code is loaded: `kept` asks for that
    with kept(f"{study}-{fold}-{clustering}", params, run.md5s, compute) as keep:
        classifier, progress = finetune_classifier(table, views, weights, params, compute, keep)
    progress.require_all_epochs()
    seconds = json.loads(pretrained.read_text())["seconds"]
    how = replace(params.evaluate, stop_at=0.0)
    found = evaluate_table(classifier, table, params.cluster, how, compute, params.seed, timed=timed)
    costs = {
        "weights": weights_of(classifier),
        "weights.head": weights_of(classifier.head),
        "pretrain": seconds,
        "finetune": progress.seconds,
        **{f"{name}_ms": value["median"] for name, value in found.latency_ms.items()},
        "peak_mb": peak_mb(),
    }
    predicted = {protocol: trials.predicted for protocol, trials in found.protocols.items()}
    labels, groups = found.labels, found.groups
    recipe = recipe_of(params)
    answers = Arm(arm, params.seed, fold, clustering or 0, recipe, costs, predicted, labels, groups, table.classes)
    write_arm(out, answers)
    errors = {protocol: 1 - float(answers.right(protocol).mean()) for protocol in predicted}
    each = ", ".join(f"{protocol} {100 * error:.1f} %" for protocol, error in errors.items())
    print(f"{study}: {arm}, seed {params.seed}, fold {fold}: error {each}")
    return {f"error.{protocol}": error for protocol, error in errors.items()} | costs | progress.metrics


if __name__ == "__main__":
    train()
