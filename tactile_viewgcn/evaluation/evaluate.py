"""Evaluates a classifier: its answers, their scores and their cost.

In evaluation mode a frame's feature does not depend on the other frames of its batch. Hence each
distinct frame passes the backbone once, and all answers gather features.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from tactile_viewgcn.device import Compute
from tactile_viewgcn.evaluation.trials import (
    MOST_PROBABLE,
    PROTOCOLS,
    WHOLE,
    Predictions,
    Trials,
    answer_recordings,
    run_trials,
)
from tactile_viewgcn.intervals import proportion_interval
from tactile_viewgcn.params import Params
from tactile_viewgcn.progress import progress
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.calibration import Classifier
from tactile_viewgcn.tables.counts import Counts, Gathered
from tactile_viewgcn.tables.frames import SIDES, TRAIN, Frames

SECONDS = 1.0  # for each measurement of latency
MAX_REPEATS = 50
BATCH = 64  # view sets


def evaluated_frames(classifier: Classifier, table: Frames, params: Params) -> Gathered:
    """Return the network input (n, H, W) of the evaluated set, computed when it is indexed.

    Args:
        classifier: its transform is applied to the frames.
        table: the kept frames.
        params: `evaluate.side`, which names the evaluated set.
    """

    def inputs(index: np.ndarray) -> np.ndarray:
        return table.inputs(index, classifier.transform)

    return Gathered(inputs, table.on(SIDES.index(params.evaluate.side)))


def evaluate_table(
    classifier: Classifier,
    table: Frames,
    params: Params,
    compute: Compute,
    *,
    temperature: float | None,
) -> tuple[Predictions, dict[str, Any]]:
    """Classify view sets and recordings of the evaluated set.

    There is a view set for each anchor, trial and protocol. Each recording is classified once.

    Args:
        classifier: is prepared for answers here.
        table: the kept frames.
        params: the sections `evaluate` and `cluster`, and the seed.
        compute: device and precision.
        temperature: calibrates the probabilities; None if they are not calibrated.

    Returns:
        All answers, and the metrics: sizes, whether all sessions of the evaluated set are new, and
            `scores_of` each of `trials.TITLES`. The metrics are equal on every run with one seed.
    """
    side = params.evaluate.side
    train = table.on(TRAIN)
    tested = table.on(SIDES.index(side))
    classifier.prepare(compute)
    values = _frame_values(classifier, evaluated_frames(classifier, table, params))
    trials = {
        protocol: run_trials(classifier, values, table, params, protocol) for protocol in PROTOCOLS
    }
    whole = answer_recordings(classifier, values, table, params, temperature=temperature)
    trials[WHOLE] = whole
    known_sessions = np.isin(table.session[tested], table.session[train])
    anchors = {"train": int(table.anchor[train].sum()), side: int(table.anchor[tested].sum())}
    metrics: dict[str, Any] = {
        "views": classifier.views,
        "classes": len(table.classes),
        "trials": params.evaluate.trials,
        "frames": anchors,
        "recordings": {side: len(np.unique(table.recording[tested]))},
        "groups": {side: len(np.unique(whole.groups))},
        "new_sessions": not known_sessions.any(),
    }
    for number, (protocol, answers) in enumerate(trials.items()):
        rng = stream(params.seed, "interval", number)
        metrics[protocol] = scores_of(answers, rng, len(table.classes))
    return Predictions(trials, np.array(table.classes)), metrics


def _frame_values(classifier: Classifier, frames: Gathered) -> Any:
    """Return the classifier's values of the frames (n, H, W), and show the progress."""
    with progress("frames", "frames", len(frames)) as bar:

        def read(index: np.ndarray) -> np.ndarray:
            bar.update(len(index))
            return frames[index]

        return classifier.frame_values(Gathered(read, np.arange(len(frames))))


def error_of(
    correct: np.ndarray, groups: np.ndarray, rng: np.random.Generator
) -> dict[str, float | None]:
    """Return the mean error rate over trials, and its 95 % interval, as fractions.

    The interval resamples split groups. It does not cover differences between training runs.

    Args:
        correct: bool (T, A), whether each answer is right.
        groups: (A,) split groups of the anchors.
        rng: draws the resampled groups.

    Returns:
        `mean`, `low` and `high`; the last two are None if there is only one group.
    """
    wrong = 1 - correct.mean(axis=0)
    low, high = proportion_interval(wrong, groups, rng) or (None, None)
    return {"mean": float(1 - correct.mean(axis=1).mean()), "low": low, "high": high}


def scores_of(trials: Trials, rng: np.random.Generator, classes: int) -> dict[str, Any]:
    """Return error rates of trials, as fractions.

    Args:
        trials: the answers.
        rng: draws the resampled groups of the intervals.
        classes: number of classes.

    Returns:
        `error`, see `error_of`, with its standard deviation `std` over trials, which differ only in
            their clustering and draws; `top3_error` if there are four classes or more; `by_views`,
            the error by the number of frames. The number is of view sets up to V; for whole
            recordings it is their median number only.
    """
    error: dict[str, float | None] = error_of(trials.correct, trials.groups, rng)
    by_views = {
        str(count): error_of(correct, trials.groups, rng) for count, correct in trials.fewer.items()
    }
    by_views[str(trials.frames)] = error
    std = 0.0
    if len(trials.correct) > 1:
        std = float(trials.correct.mean(axis=1).std(ddof=1))
    scores: dict[str, Any] = {"error": error | {"std": std}}
    if classes > MOST_PROBABLE:
        in_top3 = (trials.best == trials.labels[:, None]).any(axis=-1)
        scores["top3_error"] = float(1 - in_top3.mean())
    scores["by_views"] = by_views
    return scores


def latency(
    classifier: Classifier, inputs: Counts, live: np.ndarray, whole: int, seconds: float = SECONDS
) -> dict[str, dict[str, float]]:
    """Return milliseconds per answer from network input to logits.

    Args:
        classifier: is prepared for answers.
        inputs: (n, H, W) network input. The timed answers repeat it, so n can be below V.
        live: bool (H, W) sensors.
        whole: number of frames of the recording that is timed.
        seconds: duration of each measurement.

    Returns:
        {"single": {"median", "p95"}, "batch": {"median"}, "whole": {"median"}}: for one view set,
            for 64 view sets at once, and for a whole recording. The 95th percentile is
            interpolated.
    """
    views = classifier.views
    single_set = np.arange(views).reshape(1, views)
    batch_sets = np.arange(BATCH * views).reshape(BATCH, views)

    def answer_set(values: Any, frames: np.ndarray) -> None:
        classifier.view_sets(values, single_set)

    def answer_batch(values: Any, frames: np.ndarray) -> None:
        classifier.view_sets(values, batch_sets)

    def answer_recording(values: Any, frames: np.ndarray) -> None:
        classifier.recording(values, frames[:, live])

    single = _milliseconds(classifier, inputs, views, answer_set, seconds)
    batch = _milliseconds(classifier, inputs, BATCH * views, answer_batch, seconds) / BATCH
    recording = _milliseconds(classifier, inputs, whole, answer_recording, seconds)
    return {
        "single": {"median": float(np.median(single)), "p95": float(np.percentile(single, 95))},
        "batch": {"median": float(np.median(batch))},
        "whole": {"median": float(np.median(recording))},
    }


def _milliseconds(
    classifier: Classifier,
    inputs: Counts,
    count: int,
    answer: Callable[[Any, np.ndarray], None],
    seconds: float,
) -> np.ndarray:
    """Return the milliseconds of each repeat of an answer until the time is spent.

    At least one repeat is returned. Another repeat warms up before it, and is not returned.

    Args:
        classifier: is prepared for answers.
        inputs: (n, H, W) network input.
        count: number of frames of the answer; `inputs` are repeated if they are fewer.
        answer: function of the classifier's values of these frames, and of the frames.
        seconds: time for all repeats.
    """
    frames = inputs[np.arange(count) % len(inputs)]
    taken: list[float] = []
    end = time.perf_counter() + seconds
    while len(taken) < 2 or (len(taken) <= MAX_REPEATS and time.perf_counter() < end):
        begin = time.perf_counter()
        answer(classifier.frame_values(frames), frames)
        taken.append((time.perf_counter() - begin) * 1e3)
    return np.array(taken[1:])
