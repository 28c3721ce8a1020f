"""The evaluation of a classifier: all trials of both protocols, their scores and their cost.

In evaluation mode a frame's feature does not depend on the frames beside it, so each distinct frame passes the backbone
once, and all trials of both protocols gather features.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.evaluation.predictions import Predictions, predictions_of
from tactile_viewgcn.evaluation.statistics import calibration_error, median_and_p95
from tactile_viewgcn.evaluation.trials import PROTOCOLS, TOP, Trials, all_trials, check_grasps, unit_of_grasps
from tactile_viewgcn.intervals import proportion_interval
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import Cluster, Evaluate
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.sequential import SequentialTrials, sequential_trials
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.sensors.features import every_few
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import SIDES, Frames
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.views.clustering import pool_ids

SECONDS = 1.0  # for each of the two measurements of latency
MAX_REPEATS = 50
MAX_BATCH = 256
SHARE = 1 / 8  # of the seconds that a batch may take: slower hardware gets smaller batches


@dataclass(frozen=True)
class Evaluation:
    """The trials of all protocols, their scores and their cost.

    Attributes:
        protocols: trials by protocol.
        predictions: their answers.
        metrics: sizes and scores, equal on every run with one seed; errors are fractions. For each protocol see
            `scores_of`; `recording` also has the number of grasps `joined`, if not all, and the median number of
            `frames` of recordings that are answered whole. For `sequential` prediction, if asked for, see
            `sequential_scores`.
        seconds: of all trials, including features and clustering.
        latency_ms: see `latency`; empty if it was not measured.
    """

    protocols: dict[str, Trials]
    predictions: Predictions
    metrics: dict[str, Any]
    seconds: float
    latency_ms: dict[str, dict]


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
        UserError: a confidence threshold for a classifier without temperatures; see `check_grasps`.
    """
    check_grasps(table, evaluate)
    if evaluate.confidence_threshold and not temperatures:
        raise UserError(
            f"evaluate.confidence_threshold is {evaluate.confidence_threshold:g}, and the classifier is not "
            "calibrated: fine-tune it with finetune.num_views random and split.validation above 0"
        )
    begin = time.perf_counter()
    sides = {name: table.on(SIDES.index(name)) for name in ("train", evaluate.side)}
    index = sides[evaluate.side]
    anchors, frames = np.flatnonzero(table.anchor[index]), FrameInputs(table, index, compute, classifier.transform)
    classifier.prepare(compute)
    with compute.autocast():
        features = classifier.frame_values(frames)
    protocols = all_trials(classifier, features, table, cluster, evaluate, seed, temperatures)
    groups = table.group[index][anchors]
    kept = {f"kept_{name}": len(side) for name, side in sides.items()}
    metrics: dict[str, Any] = {
        "views": classifier.views,
        "classes": len(table.classes),
        "trials": evaluate.trials,
        "frames": {name: int(table.anchor[side].sum()) for name, side in sides.items()} | kept,
        "groups": {evaluate.side: len(np.unique(groups))},
    }
    for protocol, trials in protocols.items():
        rng = stream(seed, "interval", PROTOCOLS.index(protocol))
        metrics[protocol] = scores_of(trials, groups, rng, len(table.classes))
        if trials.whole:
            metrics[protocol]["frames"] = trials.frames
    if evaluate.grasps != "all" and "recording" in protocols:
        metrics["recording"]["joined"] = {unit_of_grasps(table): evaluate.grasps}
    if evaluate.confidence_threshold and temperatures:
        recording = pool_ids(table, index, "recording")
        rngs = (stream(seed, "touches.trial", trial) for trial in range(evaluate.trials))
        answers = sequential_trials(classifier, temperatures, features, table.label[index], recording, anchors, rngs)
        rng = stream(seed, "touches.interval")
        metrics["sequential"] = sequential_scores(answers, evaluate.confidence_threshold, groups, rng)
    seconds = time.perf_counter() - begin
    whole = max((trials.frames for trials in protocols.values() if trials.whole), default=0)
    latency_ms = latency(classifier, frames, compute, whole=whole) if timed else {}
    return Evaluation(protocols, predictions_of(protocols, table, evaluate.side), metrics, seconds, latency_ms)


def error_of(correct: np.ndarray, groups: np.ndarray, rng: np.random.Generator) -> dict[str, float | None]:
    """Mean error over trials of answers bool (T, A), and the ends of its 95 % interval, as fractions.

    The interval resamples the split groups (A,) of the anchors and is conditional on the one training; its ends are
    None where there is one group.
    """
    wrong = 1 - correct.mean(axis=0)
    low, high = proportion_interval(wrong, groups, rng) or (None, None)
    return {"mean": float(1 - correct.mean(axis=1).mean()), "low": low, "high": high}


def scores_of(trials: Trials, groups: np.ndarray, rng: np.random.Generator, classes: int) -> dict[str, Any]:
    """Error, see `error_of`, and top-3 error of four classes or more, as fractions; `empty_clusters` over all trials.

    `std` is the standard deviation of the error over trials, which differ in their clustering alone. `by_views` has the
    error by the number of views up to V, or up to whole recordings, where the classifier takes fewer.
    """
    std = trials.correct.mean(axis=1).std(ddof=1) if len(trials.correct) > 1 else 0.0
    error = error_of(trials.correct, groups, rng)
    by_views = {str(count): error_of(correct, groups, rng) for count, correct in trials.fewer.items()}
    return {
        "error": error | {"std": float(std)},
        **({"top3_error": float(1 - trials.in_top3.mean())} if classes > TOP else {}),
        "empty_clusters": trials.empty,
        **({"by_views": by_views | {str(trials.frames): error}} if by_views else {}),
    }


def sequential_scores(
    trials: SequentialTrials, confidence_threshold: float, groups: np.ndarray, rng: np.random.Generator
) -> dict[str, Any]:
    """Error, calibration error and mean number of `frames` when stopping at that confidence.

    Args:
        groups: (A,) split group of the anchors.
    """
    correct, confidence, frames = trials.stopped(confidence_threshold)
    return {
        "confidence_threshold": confidence_threshold,
        "frames": float(frames.mean()),
        "error": error_of(correct, groups, rng),
        "calibration_error": calibration_error(confidence.ravel(), correct.ravel()),
    }


@torch.inference_mode()
def latency(
    classifier: Classifier, frames: Tensor | FrameInputs, compute: Compute, *, whole: int = 0, seconds: float = SECONDS
) -> dict[str, dict[str, float]]:
    """Milliseconds per answer from network input to logits, alone and in batches of `sets`.

    Args:
        frames: (n, 1, H, W); the timed view sets repeat them, n may be below V.
        whole: frames of a recording that is answered alone, in the place of view sets; 0 for view sets.
        seconds: for each of the two.

    Returns:
        {"single": {"median", "p95"}, "batch": {"median", "p95", "sets"}}
    """

    def timed(sets: int, seconds: float) -> np.ndarray:
        """Milliseconds per answer of each repeat, one at least, until the seconds are spent."""
        index = torch.from_numpy(every_few(np.arange(whole))) if whole else torch.arange(sets * classifier.views)
        inputs, end = frames[index % len(frames)], time.perf_counter() + seconds
        index = index.to(compute.device)
        taken: list[float] = []
        while len(taken) < 2 or (len(taken) <= MAX_REPEATS and time.perf_counter() < end):
            begin = time.perf_counter()
            with compute.autocast():
                values = classifier.frame_values(inputs)
            if whole and isinstance(classifier, SensorClassifier):
                classifier.recording_logits(values)
            else:
                classifier.logits(values, index.view(sets, -1)).sum().item()  # waits for the device
            taken.append((time.perf_counter() - begin) * 1e3 / sets)
        return np.array(taken[1:])  # the first one warms up

    alone, sets = timed(1, seconds), 1
    milliseconds = np.median(alone)
    while not whole and sets < MAX_BATCH and 2 * sets * milliseconds < SHARE * seconds * 1e3:
        sets *= 2
        milliseconds = timed(sets, 0)[0]
    batch = alone if whole else timed(sets, seconds)
    return {"single": median_and_p95(alone), "batch": median_and_p95(batch) | {"sets": sets}}
