"""Train and test every setting from one seed: errors, and what they cost."""

import json
from copy import deepcopy
from dataclasses import replace
from types import SimpleNamespace

import click
import numpy as np
import torch

from stages.command import INPUT, OUTPUT, stage
from studies.error_time.settings import Setting, changed, reuses, settings
from studies.frames import VALIDATION_SHARE, validated
from tactile_viewgcn.classifier import Classifier
from tactile_viewgcn.clustering import cluster_table, pool_ids
from tactile_viewgcn.compute import Compute, choose, keep_freed_memory
from tactile_viewgcn.evaluation import Evaluation, evaluate_table
from tactile_viewgcn.files import whole
from tactile_viewgcn.finetuning import finetune_classifier
from tactile_viewgcn.frames import Frames
from tactile_viewgcn.nn.backbone import features_of
from tactile_viewgcn.preprocessing import prepare
from tactile_viewgcn.pretraining import pretrain_backbone
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recordings import Recordings
from tactile_viewgcn.split import TEST
from tactile_viewgcn.touches import calibrate, touch
from tactile_viewgcn.viewpoints import viewpoints

STOPS = (0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99)


@stage(
    "seed", "views", "viewpoints", "device", "precision", "preprocess", "split", "cluster", "augment", "pretrain",
    "model", "finetune", "evaluate",
)  # fmt: skip
@click.option("--recordings", type=INPUT, required=True)
@click.option("--side", type=click.Choice(["test", "validation"]), required=True, help="Where errors are measured.")
@click.option(
    "--out", type=OUTPUT, required=True, help="An .npz of the rows and of each anchor's share of right trials."
)
def trainings(params, run, recordings, side, out):
    """Train and test every setting from one seed: errors, and what they cost."""
    keep_freed_memory()
    runs = Runs(params, recordings)
    if side == "validation":
        for setting in reuses():
            runs.train_and_test(setting, runs.held_out)
    else:
        for setting in settings(params):
            runs.train_and_test(setting, runs.table)
        runs.precisions()
        runs.touches()
    with whole(out) as part, part.open("wb") as file:
        np.savez_compressed(
            file, rows=json.dumps(runs.rows), right=np.array(runs.right), groups=runs.groups, recipe=recipe_of(params)
        )
    print(f"trainings: {len(runs.rows)} rows of seed {params.seed}, errors on the {side} side")


def recipe_of(params: SimpleNamespace) -> str:
    """All that the seeds of one study have in common."""
    return repr(sorted((key, value) for key, value in vars(params).items() if key != "seed"))


class Runs:
    """The trainings of one seed; a backbone is pretrained once for all settings that agree on it.

    Attributes:
        rows: what each cost; right: (A,) each anchor's share of right trials, a line per row; groups: (A,).
    """

    def __init__(self, params: SimpleNamespace, recordings):
        self.params, self.compute = params, choose(params.device, params.precision)
        share = params.split.validation or VALIDATION_SHARE
        with Recordings(recordings) as table:
            self.table, self._validated = (
                prepare(table, params.preprocess, how, stream(how.seed, "preprocess"))[0]
                for how in (params.split, replace(params.split, validation=share))
            )
        self.held_out = validated(self._validated)
        self.rows, self.right, self.groups, self._backbones, self._trained = [], [], None, {}, {}

    def train_and_test(self, setting: Setting, table: Frames) -> None:
        """A row for each protocol."""
        how = changed(self.params, setting.changes)
        classifier, seconds = self.trained(how, table)
        self.note(setting, self.tested(classifier, table, how, self.compute), seconds)

    def trained(self, how: SimpleNamespace, table: Frames) -> tuple[Classifier, dict[str, float]]:
        """The classifier of a recipe, and the seconds that its two trainings took."""
        key = repr((how.views, how.viewpoints, how.pretrain, how.model, how.finetune, id(table)))
        if key not in self._trained:
            weights, first = self._backbone(how, table)
            places = viewpoints(how.views, how.viewpoints, how.seed)
            views = cluster_table(table, places, how.cluster, stream(how.seed, "cluster"))
            classifier, progress = finetune_classifier(table, views, weights, how, self.compute)
            progress.require_all_epochs()
            self._trained[key] = classifier, {"pretrain": first, "finetune": progress.seconds}
        return self._trained[key]

    def _backbone(self, how: SimpleNamespace, table: Frames) -> tuple[dict[str, dict], float]:
        key = repr((how.pretrain, how.model.backbone, id(table)))
        if key not in self._backbones:
            backbone, classifier, progress = pretrain_backbone(table, how, self.compute)
            progress.require_all_epochs()
            weights = {"backbone": backbone.state_dict(), "classifier": classifier.state_dict()}
            self._backbones[key] = weights, progress.seconds
        return self._backbones[key]

    def tested(self, classifier: Classifier, table: Frames, how: SimpleNamespace, compute: Compute) -> Evaluation:
        """All trials of a copy of the classifier."""
        return evaluate_table(
            deepcopy(classifier), table, how.cluster, replace(how.evaluate, stop_at=0.0), compute, how.seed
        )

    def note(self, setting: Setting, found: Evaluation, seconds: dict[str, float]) -> None:
        """Its rows, one per protocol."""
        latency = {f"{name}_ms": value["median"] for name, value in found.latency_ms.items()}
        for protocol, trials in found.protocols.items():
            self.add(setting.axis, setting.value, protocol, trials.right.mean(axis=0), found.groups, seconds | latency)

    def add(self, axis: str, value: str, protocol: str, right: np.ndarray, groups: np.ndarray, costs: dict) -> None:
        row = {"axis": axis, "value": value, "seed": self.params.seed, "protocol": protocol} | costs
        self.rows.append(row)
        self.right.append(right)
        self.groups = groups
        print(f"  {axis} {value}, {protocol}: error {100 * (1 - right.mean()):.1f} %", flush=True)

    def precisions(self) -> None:
        """The default's classifier, used in each precision."""
        classifier, seconds = self.trained(self.params, self.table)
        for name in ("float64", "float32", "bfloat16"):
            found = self.tested(classifier, self.table, self.params, Compute(self.compute.device, name))
            self.note(Setting("precision", name, {}), found, seconds)

    def touches(self) -> None:
        """One classifier of any number of touches, calibrated on validation groups: each fixed number, each stop."""
        how = changed(self.params, {"finetune.sizes": "random"})
        classifier, seconds = self.trained(how, self._validated)
        temperatures = calibrate(classifier, self._validated, self.compute, how.seed)
        index = self.table.on(TEST)
        label, recording = self.table.label[index], self.table.recording[index]
        with torch.inference_mode(), self.compute.autocast():
            features = features_of(classifier.backbone, self.compute.frames(torch.from_numpy(self.table.inputs(index))))
        anchors = np.flatnonzero(self.table.anchor[index])
        trials = [stream(how.seed, "touches.trial", trial) for trial in range(how.evaluate.trials)]
        pool = pool_ids(label, recording, self.table.side[index], "recording")
        found = touch(classifier, temperatures, features, label, pool, anchors, trials)
        groups = self.table.group[index][anchors]
        for count in range(1, classifier.views + 1):
            right = found.right[:, count - 1].mean(axis=0)
            self.add("touches", f"fixed {count}", "recording", right, groups, seconds | {"touches": count})
        for stop_at in STOPS:
            right, taken = found.stopped(stop_at)
            costs = seconds | {"touches": float(taken.mean())}
            self.add("touches", f"stop at {stop_at:g}", "recording", right.mean(axis=0), groups, costs)


if __name__ == "__main__":
    trainings()
