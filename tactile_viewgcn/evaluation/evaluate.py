"""The evaluation of a classifier: its answers to view sets and to whole recordings, their scores and their cost.

In evaluation mode a frame's feature does not depend on the frames beside it, so each distinct frame
passes the backbone once, and all answers gather features.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from tactile_viewgcn.device import Compute
from tactile_viewgcn.evaluation.trials import (
    PROTOCOLS,
    TOP,
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
from tactile_viewgcn.tables.frames import SIDES, Frames

SECONDS = 1.0  # for each measurement of latency
MAX_REPEATS = 50
BATCH = 64  # view sets


def evaluated_frames(classifier: Classifier, table: Frames, params: Params) -> Gathered:
    """What the classifier reads of the frames (n, H, W) of the side `evaluate.side`, computed when it is indexed."""
    return Gathered(
        lambda at: table.inputs(at, classifier.transform),
        table.on(SIDES.index(params.evaluate.side)),
    )


def evaluate_table(
    classifier: Classifier, table: Frames, params: Params, compute: Compute
) -> tuple[Predictions, dict[str, Any]]:
    """Classify the side `evaluate.side`: a view set for each anchor, trial and protocol, and each recording once.

    Returns:
        All answers; and metrics: sizes, whether all sessions are other ones than the training's,
            and `scores_of` each
        of `trials.ASKED`. They are equal on every run with one seed.
    """
    side = params.evaluate.side
    train, tested = (table.on(SIDES.index(name)) for name in ("train", side))
    classifier.prepare(compute)
    values = _frame_values(classifier, evaluated_frames(classifier, table, params))
    trials = {
        protocol: run_trials(classifier, values, table, params, protocol) for protocol in PROTOCOLS
    }
    trials[WHOLE] = answer_recordings(classifier, values, table, params)
    metrics: dict[str, Any] = {
        "views": classifier.views,
        "classes": len(table.classes),
        "trials": params.evaluate.trials,
        "frames": {
            name: int(table.anchor[at].sum()) for name, at in (("train", train), (side, tested))
        },
        "recordings": {side: len(trials[WHOLE].labels)},
        "groups": {side: len(np.unique(trials[WHOLE].groups))},
        "new_sessions": bool(~np.isin(table.session[tested], table.session[train]).any()),
    }
    for number, (asked, answers) in enumerate(trials.items()):
        metrics[asked] = scores_of(
            answers, stream(params.seed, "interval", number), len(table.classes)
        )
    return Predictions(trials, np.array(table.classes)), metrics


def _frame_values(classifier: Classifier, frames: Gathered) -> Any:
    """The classifier's values of the frames (n, H, W), with the progress through them."""
    with progress("frames", "frames", len(frames)) as bar:

        def read(index: np.ndarray) -> np.ndarray:
            bar.update(len(index))
            return frames[index]

        return classifier.frame_values(Gathered(read, np.arange(len(frames))))


def error_of(
    correct: np.ndarray, groups: np.ndarray, rng: np.random.Generator
) -> dict[str, float | None]:
    """Mean error over trials of answers bool (T, A), and the ends of its 95 % interval, as fractions.

    The interval resamples the split groups (A,) of the anchors, and does not cover how trainings
    differ. Its ends are None where there is one group.
    """
    wrong = 1 - correct.mean(axis=0)
    low, high = proportion_interval(wrong, groups, rng) or (None, None)
    return {"mean": float(1 - correct.mean(axis=1).mean()), "low": low, "high": high}


def scores_of(trials: Trials, rng: np.random.Generator, classes: int) -> dict[str, Any]:
    """Errors of trials, as fractions.

    Args:
        rng: of the intervals.
        classes: their number.

    Returns:
        `error`, see `error_of`, with its standard deviation `std` over trials, which differ in
            their clustering alone;
        `top3_error` of four classes or more; `by_views`, the error by the number of frames: of view
            sets up to V, or
        for whole recordings the median number alone.
    """
    std = trials.correct.mean(axis=1).std(ddof=1) if len(trials.correct) > 1 else 0.0
    in_top3 = (trials.best == trials.labels[:, None]).any(axis=-1)
    error = error_of(trials.correct, trials.groups, rng)
    by_views = {
        str(count): error_of(correct, trials.groups, rng) for count, correct in trials.fewer.items()
    }
    return {
        "error": error | {"std": float(std)},
        **({"top3_error": float(1 - in_top3.mean())} if classes > TOP else {}),
        "by_views": by_views | {str(trials.frames): error},
    }


def latency(
    classifier: Classifier, inputs: Counts, live: np.ndarray, whole: int, seconds: float = SECONDS
) -> dict[str, dict[str, float]]:
    """Milliseconds per answer from network input to logits.

    Args:
        classifier: prepared for answers.
        inputs: (n, H, W); the timed answers repeat them, n may be below V.
        live: bool (H, W) sensors.
        whole: frames of the recording that is timed.
        seconds: for each measurement.

    Returns:
        {"single": {"median", "p95"}, "batch": {"median"}, "whole": {"median"}}: of one view set, of
            64 at once, and of
        a whole recording; the 95th percentile is interpolated.
    """

    def timed(index: np.ndarray, answer: Callable[[Any, np.ndarray], Any]) -> np.ndarray:
        """Milliseconds of each repeat after one that warms up: one at least, until the seconds are spent."""
        frames, taken, end = (
            inputs[index % len(inputs)],
            list[float](),
            time.perf_counter() + seconds,
        )
        while len(taken) < 2 or (len(taken) <= MAX_REPEATS and time.perf_counter() < end):
            begin = time.perf_counter()
            answer(classifier.frame_values(frames), frames)
            taken.append((time.perf_counter() - begin) * 1e3)
        return np.array(taken[1:])  # the first one warms up

    one, more = (np.arange(count * classifier.views).reshape(count, -1) for count in (1, BATCH))
    single = timed(one.ravel(), lambda values, frames: classifier.view_sets(values, one))
    batch = timed(more.ravel(), lambda values, frames: classifier.view_sets(values, more)) / BATCH
    recording = timed(
        np.arange(whole), lambda values, frames: classifier.recording(values, frames[:, live])
    )
    return {
        "single": {"median": float(np.median(single)), "p95": float(np.percentile(single, 95))},
        "batch": {"median": float(np.median(batch))},
        "whole": {"median": float(np.median(recording))},
    }
