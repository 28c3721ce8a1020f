"""The evaluation of a classifier: all trials of both protocols, their scores and their cost.

In evaluation mode a frame's feature does not depend on the frames beside it, so each distinct frame passes the backbone
once, and all trials of both protocols gather features.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from tactile_viewgcn.device import Compute
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.evaluation.latency import latency
from tactile_viewgcn.evaluation.statistics import calibration_error, confusion_counts
from tactile_viewgcn.evaluation.trials import PROTOCOLS, Trials, all_trials
from tactile_viewgcn.frames.split import SIDES
from tactile_viewgcn.intervals import proportion_interval
from tactile_viewgcn.nn.backbone import extract_features
from tactile_viewgcn.params import Cluster, Evaluate
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.sequential import SequentialTrials, sequential_trials
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.views.clustering import pool_ids


@dataclass(frozen=True)
class Evaluation:
    """The trials of all protocols, their scores and their cost.

    Attributes:
        protocols: trials by protocol.
        labels, groups: (A,) class and split group of the anchors.
        scores: of each protocol, see `summary`; of `sequential` prediction, if asked for, see `sequential_summary`.
        seconds: of all trials, including features and clustering.
        latency_ms: see `latency`; empty if it was not measured.
    """

    protocols: dict[str, Trials]
    labels: np.ndarray
    groups: np.ndarray
    scores: dict[str, dict]
    seconds: float
    latency_ms: dict[str, dict]

    @property
    def trials(self) -> int:
        return len(next(iter(self.protocols.values())).correct)

    def confusion(self, protocol: str, classes: int) -> np.ndarray:
        """Counts int64 (classes, classes) over all trials: row the true class, column the predicted one."""
        return confusion_counts(self.labels, self.protocols[protocol].predicted, classes)


def evaluate_table(
    classifier: Classifier,
    table: Frames,
    cluster: Cluster,
    evaluate: Evaluate,
    compute: Compute,
    seed: int,
    temperatures: list[float] | None = None,
    *,
    timed: bool = True,
) -> Evaluation:
    """All trials on the side `evaluate.side`, and sequential ones if `evaluate.confidence_threshold` is above 0.

    Args:
        temperatures: of the classifier, for 1 to V frames.
        timed: measure the latency too.

    Raises:
        UserError: a confidence threshold for a classifier without temperatures.
    """
    if evaluate.confidence_threshold and not temperatures:
        raise UserError(
            f"evaluate.confidence_threshold is {evaluate.confidence_threshold:g}, and the classifier is not "
            "calibrated: fine-tune it with finetune.num_views random and split.validation above 0"
        )
    begin = time.perf_counter()
    index = table.on(SIDES.index(evaluate.side))
    anchors = np.flatnonzero(table.anchor[index])
    frames = FrameInputs(table, index, compute, classifier.head.transform)
    classifier.eval().to(compute.device, compute.dtype, memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's types lack it
    with compute.autocast():
        features = extract_features(classifier.backbone, frames)
    groups = table.group[index][anchors]
    protocols = all_trials(classifier, features, table, cluster, evaluate, seed)
    scores = {
        protocol: summary(trials, groups, stream(seed, "interval", PROTOCOLS.index(protocol)))
        for protocol, trials in protocols.items()
    }
    if evaluate.confidence_threshold and temperatures:
        recording = pool_ids(table.label[index], table.recording[index], table.side[index], "recording")
        trials = (stream(seed, "touches.trial", trial) for trial in range(evaluate.trials))
        sequential = sequential_trials(
            classifier, temperatures, features, table.label[index], recording, anchors, trials
        )
        scores["sequential"] = sequential_summary(
            sequential, evaluate.confidence_threshold, groups, stream(seed, "touches.interval")
        )
    seconds = time.perf_counter() - begin
    latency_ms = latency(classifier, frames, compute) if timed else {}
    return Evaluation(protocols, table.label[index][anchors], groups, scores, seconds, latency_ms)


def summary(trials: Trials, groups: np.ndarray, rng: np.random.Generator) -> dict[str, Any]:
    """Top-1, top-3 and error as fractions: means over trials, standard deviation and interval.

    `std` is the standard deviation over trials, which differ in their clustering alone; `ci95` resamples the
    split groups (A,) of the anchors and is conditional on the one training; `empty_clusters` counts the clusters
    without frames over all trials.
    """
    top1 = trials.correct.mean(axis=1)
    interval = proportion_interval(trials.correct.mean(axis=0), groups, rng)
    return {
        "top1": {
            "mean": float(top1.mean()),
            "std": float(top1.std(ddof=1)) if len(top1) > 1 else 0.0,
            "ci95": {"low": interval[0], "high": interval[1]} if interval else None,
        },
        "top3": {"mean": float(trials.in_top3.mean())},
        "error": {"mean": float(1 - top1.mean())},
        "empty_clusters": trials.empty,
    }


def sequential_summary(
    trials: SequentialTrials, confidence_threshold: float, groups: np.ndarray, rng: np.random.Generator
) -> dict[str, Any]:
    """Error and mean number of frames when stopping at that confidence, and the error of every fixed number.

    Errors are fractions, means over trials, with a 95 % interval that resamples the split groups (A,); for a fixed
    number also the calibration error.
    """

    def error(correct: np.ndarray) -> dict[str, Any]:
        interval = proportion_interval(correct.mean(axis=0), groups, rng)
        ends = {"low": 1 - interval[1], "high": 1 - interval[0]} if interval else None
        return {"error": float(1 - correct.mean()), "ci95": ends}

    fixed = {}
    for number in range(trials.correct.shape[1]):
        correct, confidence = trials.correct[:, number], trials.confidence[:, number]
        score = calibration_error(confidence.ravel(), correct.ravel())
        fixed[str(number + 1)] = error(correct) | {"calibration_error": score}
    correct, count = trials.stopped(confidence_threshold)
    return {"confidence_threshold": confidence_threshold, "mean": float(count.mean()), **error(correct), "fixed": fixed}
