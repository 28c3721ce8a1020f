"""The evaluation of a classifier: all trials of both protocols, their scores and their cost.

In evaluation mode a frame's feature does not depend on the frames beside it, so each distinct frame passes the backbone
once, and all trials of both protocols gather features.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_viewgcn.device import Compute
from tactile_viewgcn.evaluation.predictions import Predictions, predictions_of
from tactile_viewgcn.evaluation.trials import PROTOCOLS, TOP, Trials, all_trials
from tactile_viewgcn.intervals import proportion_interval
from tactile_viewgcn.params import Params
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.counts import Counts, Gathered
from tactile_viewgcn.tables.frames import SIDES, Frames

SECONDS = 1.0  # for each of the two measurements of latency
MAX_REPEATS = 50
BATCH = 64  # view sets


@dataclass(frozen=True)
class Evaluation:
    """The trials of all protocols, their scores and their cost.

    Attributes:
        protocols: trials by protocol.
        predictions: their answers.
        metrics: sizes and scores, equal on every run with one seed; errors are fractions. For each protocol see
            `scores_of`; `recording` also has the median number of `frames` of recordings that are answered whole.
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
    params: Params,
    compute: Compute,
    temperature: float | None = None,
    *,
    timed: bool = True,
) -> Evaluation:
    """All trials on the side `evaluate.side`.

    Args:
        temperature: of the classifier, if it is calibrated.
        timed: measure the latency too.
    """
    begin, evaluate, seed = time.perf_counter(), params.evaluate, params.seed
    sides = {name: table.on(SIDES.index(name)) for name in ("train", evaluate.side)}
    index = sides[evaluate.side]
    inputs = Gathered(lambda at: table.inputs(at, classifier.transform), index)
    classifier.prepare(compute)
    values = classifier.frame_values(inputs)
    protocols = all_trials(classifier, values, table, params, temperature)
    groups = table.group[index][table.anchor[index]]
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
    seconds = time.perf_counter() - begin
    whole = max((trials.frames for trials in protocols.values() if trials.whole), default=0)
    latency_ms = latency(classifier, inputs, whole=whole) if timed else {}
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


def latency(
    classifier: Classifier, inputs: Counts, *, whole: int = 0, seconds: float = SECONDS
) -> dict[str, dict[str, float]]:
    """Milliseconds per answer from network input to logits, alone and in a batch of 64 view sets.

    Args:
        classifier: prepared for answers.
        inputs: (n, H, W); the timed view sets repeat them, n may be below V.
        whole: frames of a recording that is answered alone, in the place of view sets; 0 for view sets.
        seconds: for each of the two.

    Returns:
        {"single": {"median", "p95"}, "batch": {"median", "p95", "sets"}}
    """

    def timed(sets: int) -> np.ndarray:
        """Milliseconds per answer of each repeat, one at least, until the seconds are spent."""
        index = classifier.frames_of(whole) if whole else np.arange(sets * classifier.views)
        frames, end = inputs[index % len(inputs)], time.perf_counter() + seconds
        index = np.arange(len(frames)).reshape(sets, -1)
        taken: list[float] = []
        while len(taken) < 2 or (len(taken) <= MAX_REPEATS and time.perf_counter() < end):
            begin = time.perf_counter()
            values: Any = classifier.frame_values(frames)
            if whole:
                classifier.recording(values)
            else:
                classifier.view_sets(values, index)
            taken.append((time.perf_counter() - begin) * 1e3 / sets)
        return np.array(taken[1:])  # the first one warms up

    alone = timed(1)
    batch, sets = (alone, 1) if whole else (timed(BATCH), BATCH)
    return {"single": median_and_p95(alone), "batch": median_and_p95(batch) | {"sets": sets}}


def median_and_p95(values: np.ndarray) -> dict[str, float]:
    """Median and 95th percentile of values (n,), n at least 1, interpolated between neighbours."""
    return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95))}
