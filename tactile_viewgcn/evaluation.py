"""Ten trials on the test side: each clusters it anew and classifies one view set per anchor frame.

In evaluation a frame's feature does not depend on the frames beside it, so each distinct frame goes through the
backbone once, and all trials of both protocols only gather features.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from tactile_viewgcn.assignment import arranged, touched_above
from tactile_viewgcn.classifier import Classifier, logits_of_sets
from tactile_viewgcn.clustering import cluster_pools, pool_ids, pool_scores
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.frames import Frames
from tactile_viewgcn.nn.backbone import features_of
from tactile_viewgcn.params import Cluster, Evaluate
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.split import TEST
from tactile_viewgcn.statistics import calibration_error, middle_and_tail, share_interval
from tactile_viewgcn.touches import Touched, touch
from tactile_viewgcn.views import ViewSets

PROTOCOLS = ("object", "recording")
TOP = 3
SINGLE_REPEATS, BATCH_REPEATS = 50, 8


@dataclass(frozen=True)
class Trials:
    """What T trials said of A anchors under one protocol.

    Attributes:
        predicted: int64 (T, A) most probable class.
        right: bool (T, A); near: bool (T, A) the true class among the three most probable.
        empty: clusters without frames, drawn by repetition, summed over the trials.
    """

    predicted: np.ndarray
    right: np.ndarray
    near: np.ndarray
    empty: int


@dataclass(frozen=True)
class Evaluation:
    """All trials of all protocols, what they add up to and what they cost.

    Attributes:
        protocols: trials by protocol; labels, groups: (A,) class and split group of the anchors.
        scores: of each protocol, see `summary`; of `touches`, where asked for, see `touch_summary`.
        seconds: of all trials, features and clustering included.
        latency_ms: see `latency`; empty where it was not measured.
    """

    protocols: dict[str, Trials]
    labels: np.ndarray
    groups: np.ndarray
    scores: dict[str, dict]
    seconds: float
    latency_ms: dict[str, dict]

    @property
    def trials(self) -> int:
        return len(next(iter(self.protocols.values())).right)

    def confusion(self, scope: str, classes: int) -> np.ndarray:
        """Counts int64 (classes, classes) over all trials: row the true class, column the predicted one."""
        predicted = self.protocols[scope].predicted
        cells = np.broadcast_to(self.labels.astype(np.int64), predicted.shape) * classes + predicted
        return np.bincount(cells.ravel(), minlength=classes**2).reshape(classes, classes)


def evaluate_table(
    classifier: Classifier,
    table: Frames,
    how: Cluster,
    what: Evaluate,
    compute: Compute,
    seed: int,
    temperatures: list[float] | None = None,
    *,
    timed: bool = True,
) -> Evaluation:
    """All trials of the protocols in `what.scope`, and of touches with `what.stop_at`, on the table's test side.

    Args:
        timed: measure the latency too.

    Raises:
        ValueError: touches are asked for, and the classifier has no temperatures.
    """
    if what.stop_at and not temperatures:
        raise ValueError(
            f"evaluate.stop_at is {what.stop_at:g}, and the classifier is not calibrated: fine-tune it with "
            "finetune.sizes random and split.validation above 0"
        )
    begin = time.perf_counter()
    index = table.on(TEST)
    anchors = np.flatnonzero(table.anchor[index])
    frames = compute.frames(torch.from_numpy(table.inputs(index)))
    classifier.eval().to(compute.device, compute.dtype, memory_format=torch.channels_last)
    with compute.autocast():
        features = features_of(classifier.backbone, frames)
    groups = table.group[index][anchors]
    found = all_trials(classifier, features, table, how, what, seed)
    scores = {
        scope: summary(trials, groups, stream(seed, "interval", PROTOCOLS.index(scope)))
        for scope, trials in found.items()
    }
    if what.stop_at:
        recording = pool_ids(table.label[index], table.recording[index], table.side[index], "recording")
        trials = (stream(seed, "touches.trial", trial) for trial in range(what.trials))
        touched = touch(classifier, temperatures, features, table.label[index], recording, anchors, trials)
        scores["touches"] = touch_summary(touched, what.stop_at, groups, stream(seed, "touches.interval"))
    seconds = time.perf_counter() - begin
    paid = latency(classifier, frames, compute) if timed else {}
    return Evaluation(found, table.label[index][anchors], groups, scores, seconds, paid)


def all_trials(
    classifier: Classifier, features: Tensor, table: Frames, how: Cluster, what: Evaluate, seed: int
) -> dict[str, Trials]:
    """The trials of each protocol in `what.scope`, with the same view sets for every classifier of so many views.

    Args:
        classifier: its `head` joins the views; its `views` and `references` are read.
        features: (n, ...) of the test side's frames, what the head takes.
    """
    index, found = table.on(TEST), {}
    points, label = table.inputs(index)[:, table.live], table.label[index]
    anchors, touched = np.flatnonzero(table.anchor[index]), touched_above(table.kind, table.scale)
    with tqdm(total=len(what.scope) * what.trials, desc="evaluate", unit="trial", disable=None) as bar:
        for number, scope in enumerate(PROTOCOLS):
            if scope not in what.scope:
                continue
            pool = pool_ids(label, table.recording[index], table.side[index], scope)
            trials = (stream(seed, "trial", number, trial) for trial in range(what.trials))
            found[scope] = run_trials(
                classifier, features, points, label, pool, anchors, how, touched=touched, trials=trials, bar=bar
            )
    return found


@torch.inference_mode()
def run_trials(
    classifier: Classifier,
    features: Tensor,
    points: np.ndarray,
    labels: np.ndarray,
    pool: np.ndarray,
    anchors: np.ndarray,
    how: Cluster,
    *,
    touched: float,
    trials: Iterable[np.random.Generator],
    bar: tqdm,
) -> Trials:
    """Classify one view set per anchor in each trial, each with its own generator and clustering.

    Args:
        features: (n, C) of the test frames; points: (n, d) what clustering sees; labels, pool: (n,).
        anchors: (A,) indices of the test frames that view sets are drawn around.
        touched: see `assignment.touched_above`.
    """
    views, scores, empty = classifier.views, None, 0
    if how.method == "kmeans" and views > 1:
        scores = pool_scores(points, pool, how.components)
    top, truth = [], torch.from_numpy(labels[anchors].astype(np.int64))
    for rng in trials:
        cluster = cluster_pools(points, pool, views, how, rng, scores)
        cluster = arranged(
            cluster, pool, points, views, how.assignment, touched=touched, references=classifier.references
        )
        sets = ViewSets(cluster, pool, views)
        drawn = torch.from_numpy(sets.draw(anchors, rng, how.assignment)).to(features.device)
        logits = logits_of_sets(classifier.head, features, drawn)
        order = logits.argsort(dim=-1, descending=True, stable=True)  # ties to the lowest class
        top.append(order[:, :TOP].cpu())
        empty += int(sets.empty.sum())
        bar.update()
    best = torch.stack(top)  # (T, A, 3)
    near = (best == truth[:, None]).any(dim=-1)
    return Trials(best[..., 0].numpy(), (best[..., 0] == truth).numpy(), near.numpy(), empty)


def summary(trials: Trials, groups: np.ndarray, rng: np.random.Generator) -> dict[str, dict]:
    """Top-1, top-3 and error as fractions: means over trials, the spread between them, and the interval.

    `spread` is the standard deviation over trials, which differ in their clustering alone; `ci95` resamples the
    split groups (A,) of the anchors and is conditional on the one training; `empty_clusters` counts the clusters
    drawn by repetition, over all trials.
    """
    each = trials.right.mean(axis=1)
    interval = share_interval(trials.right.mean(axis=0), groups, rng)
    return {
        "top1": {
            "mean": float(each.mean()),
            "spread": float(each.std(ddof=1)) if len(each) > 1 else 0.0,
            "ci95": list(interval) if interval else None,
        },
        "top3": {"mean": float(trials.near.mean())},
        "error": {"mean": float(1 - each.mean())},
        "empty_clusters": trials.empty,
    }


def touch_summary(touched: Touched, stop_at: float, groups: np.ndarray, rng: np.random.Generator) -> dict[str, Any]:
    """Error and mean number of touches when stopping at that certainty, and the error of every fixed number.

    Errors are fractions, means over trials, with the 95 % interval that resamples the split groups (A,); of a fixed
    number there is also the calibration error.
    """

    def error(right: np.ndarray) -> dict[str, Any]:
        interval = share_interval(right.mean(axis=0), groups, rng)
        return {"error": float(1 - right.mean()), "ci95": [1 - interval[1], 1 - interval[0]] if interval else None}

    right, count = touched.stopped(stop_at)
    fixed = {}
    for number in range(touched.right.shape[1]):
        own, sure = touched.right[:, number], touched.certainty[:, number]
        fixed[str(number + 1)] = error(own) | {"calibration_error": calibration_error(sure.ravel(), own.ravel())}
    return {"stop_at": stop_at, "mean": float(count.mean()), **error(right), "fixed": fixed}


@torch.inference_mode()
def latency(classifier: Classifier, frames: Tensor, compute: Compute, *, batch: int = 256) -> dict[str, dict]:
    """Milliseconds per view set from network input to logits, alone and in batches.

    Args:
        frames: (n, 1, H, W); the view sets timed are its frames over and over, n need not reach V.

    Returns:
        {"single": {"median", "p95"}, "batch": {"median", "p95"}}
    """

    def timed(sets: int, repeats: int) -> np.ndarray:
        index = torch.arange(sets * classifier.views, device=frames.device)
        inputs, taken = frames[index % len(frames)], []
        for _ in range(1 + repeats):
            begin = time.perf_counter()
            with compute.autocast():
                features = features_of(classifier.backbone, inputs)
            logits_of_sets(classifier.head, features, index.view(sets, -1)).sum().item()  # waits for the device
            taken.append((time.perf_counter() - begin) * 1e3 / sets)
        return np.array(taken[1:])  # the first one warms up

    alone, together = timed(1, SINGLE_REPEATS), timed(batch, BATCH_REPEATS)
    return {"single": middle_and_tail(alone), "batch": middle_and_tail(together)}
