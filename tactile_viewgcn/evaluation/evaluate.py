"""The evaluation of a classifier: all trials of both protocols, their scores and their cost.

In evaluation mode a frame's feature does not depend on the frames beside it, so each distinct frame passes the backbone
once, and all trials of both protocols gather features.
"""

import time
from typing import Any, NamedTuple

import numpy as np

from tactile_viewgcn.device import Compute
from tactile_viewgcn.evaluation.trials import PROTOCOLS, TOP, Predictions, Trials, predictions_of, run_trials
from tactile_viewgcn.intervals import proportion_interval
from tactile_viewgcn.params import Params
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.classifier import Classifier
from tactile_viewgcn.tables.counts import Counts, Gathered
from tactile_viewgcn.tables.frames import SIDES, Frames

SECONDS = 1.0  # for each of the two measurements of latency
MAX_REPEATS = 50
BATCH = 64  # view sets


class Evaluation(NamedTuple):
    """The answers of all trials, their scores and their cost.

    Attributes:
        predictions: the answers by protocol.
        metrics: sizes, and `scores_of` each protocol; equal on every run with one seed.
        latency_ms: see `latency`; empty if it was not measured.
    """

    predictions: Predictions
    metrics: dict[str, Any]
    latency_ms: dict[str, dict[str, float]]


def evaluate_table(
    classifier: Classifier,
    table: Frames,
    params: Params,
    compute: Compute,
    temperature: float | None = None,
    *,
    timed: bool = True,
) -> Evaluation:
    """Run all trials of both protocols on the side `evaluate.side`, and score them.

    Args:
        temperature: of the classifier, if it is calibrated.
        timed: measure the latency too.
    """
    side = params.evaluate.side
    train, tested = (table.on(SIDES.index(name)) for name in ("train", side))
    groups = table.group[tested[table.anchor[tested]]]
    inputs = Gathered(lambda at: table.inputs(at, classifier.transform), tested)
    classifier.prepare(compute)
    values = classifier.frame_values(inputs)
    metrics: dict[str, Any] = {
        "views": classifier.views,
        "classes": len(table.classes),
        "trials": params.evaluate.trials,
        "frames": {"train": int(table.anchor[train].sum()), side: len(groups)},
        "groups": {side: len(np.unique(groups))},
    }
    protocols = {}
    for number, protocol in enumerate(PROTOCOLS):
        protocols[protocol] = trials = run_trials(classifier, values, table, params, protocol, temperature)
        metrics[protocol] = scores_of(trials, groups, stream(params.seed, "interval", number), len(table.classes))
    whole = max((trials.frames for trials in protocols.values() if trials.whole), default=0)
    latency_ms = latency(classifier, inputs, whole=whole) if timed else {}
    return Evaluation(predictions_of(protocols, table, side), metrics, latency_ms)


def error_of(correct: np.ndarray, groups: np.ndarray, rng: np.random.Generator) -> dict[str, float | None]:
    """Mean error over trials of answers bool (T, A), and the ends of its 95 % interval, as fractions.

    The interval resamples the split groups (A,) of the anchors and is conditional on the one training; its ends are
    None where there is one group.
    """
    wrong = 1 - correct.mean(axis=0)
    low, high = proportion_interval(wrong, groups, rng) or (None, None)
    return {"mean": float(1 - correct.mean(axis=1).mean()), "low": low, "high": high}


def scores_of(trials: Trials, groups: np.ndarray, rng: np.random.Generator, classes: int) -> dict[str, Any]:
    """Errors under one protocol, as fractions.

    Args:
        groups: (A,) split groups of the anchors.
        rng: of the intervals.
        classes: their number.

    Returns:
        `error`, see `error_of`, with its standard deviation `std` over trials, which differ in their clustering alone;
        `top3_error` of four classes or more; `by_views`, the error by the number of views that the classifier takes;
        `frames` in the median recording, if recordings are answered whole.
    """
    right = trials.best == trials.truth[:, None]  # (T, A, 3)
    correct, in_top3 = right[..., 0], right.any(axis=-1)
    std = correct.mean(axis=1).std(ddof=1) if len(correct) > 1 else 0.0
    error = error_of(correct, groups, rng)
    by_views = {str(count): error_of(right, groups, rng) for count, right in trials.fewer.items()}
    return {
        "error": error | {"std": float(std)},
        **({"top3_error": float(1 - in_top3.mean())} if classes > TOP else {}),
        "by_views": by_views | {str(trials.frames): error},
        **({"frames": trials.frames} if trials.whole else {}),
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
        {"single": {"median", "p95"}, "batch": {"median"}}; the 95th percentile is interpolated.
    """

    def timed(sets: int) -> np.ndarray:
        """Milliseconds per answer of each repeat, one at least, until the seconds are spent."""
        index = classifier.frames_of(whole) if whole else np.arange(sets * classifier.views)
        frames, places = inputs[index % len(inputs)], np.arange(len(index)).reshape(sets, -1)
        taken, end = list[float](), time.perf_counter() + seconds
        while len(taken) < 2 or (len(taken) <= MAX_REPEATS and time.perf_counter() < end):
            begin = time.perf_counter()
            values: Any = classifier.frame_values(frames)
            _ = classifier.recording(values) if whole else classifier.view_sets(values, places)
            taken.append((time.perf_counter() - begin) * 1e3 / sets)
        return np.array(taken[1:])  # the first one warms up

    alone = timed(1)
    batch = alone if whole else timed(BATCH)
    single = {"median": float(np.median(alone)), "p95": float(np.percentile(alone, 95))}
    return {"single": single, "batch": {"median": float(np.median(batch))}}
