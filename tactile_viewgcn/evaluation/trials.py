"""Trials on the evaluated side: each clusters it anew and classifies one view set per anchor frame."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from tqdm import tqdm

from tactile_viewgcn.params import Params
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.calibration import recording_answers
from tactile_viewgcn.recognition.classifier import Classifier
from tactile_viewgcn.tables.frames import SIDES, Frames
from tactile_viewgcn.views.clustering import cluster_pools, pool_ids, pool_scores
from tactile_viewgcn.views.sampling import ViewSets, anchor_first, powers_of_two

PROTOCOLS = ("object", "recording")
TOP = 3


@dataclass(frozen=True)
class Trials:
    """Predictions of T trials for A anchors under one protocol.

    Attributes:
        predicted: int64 (T, A) most probable class.
        correct: bool (T, A).
        in_top3: bool (T, A) whether the true class is among the three most probable.
        fewer: `correct` by number of views, 1, 2, 4 and so on below V: the anchor and other views of its set at random,
            each time those before and more. Empty where the classifier takes V alone.
        frames: number of frames of an answer: V, or the median of the recordings that are answered `whole`.
    """

    predicted: np.ndarray
    correct: np.ndarray
    in_top3: np.ndarray
    fewer: dict[int, np.ndarray] = field(default_factory=dict)
    frames: int = 1
    whole: bool = False


def all_trials(
    classifier: Classifier, values: Any, table: Frames, params: Params, temperature: float | None = None
) -> dict[str, Trials]:
    """The trials of both protocols; the view sets are the same for all classifiers of V views.

    Args:
        values: (n, ...) of the evaluated side's frames, see `recognition.classifier`.
        temperature: of the classifier, if it is calibrated.
    """
    protocols = {}
    for number, protocol in enumerate(PROTOCOLS):
        bar = tqdm(range(params.evaluate.trials), desc=f"evaluate by {protocol}", unit="trial", disable=None)
        rngs = (stream(params.seed, "trial", number, trial) for trial in bar)
        protocols[protocol] = run_trials(classifier, values, table, params, protocol, rngs, temperature)
    return protocols


def run_trials(
    classifier: Classifier,
    values: Any,
    table: Frames,
    params: Params,
    protocol: str,
    rngs: Iterable[np.random.Generator],
    temperature: float | None = None,
) -> Trials:
    """Classify one view set per anchor of the evaluated side in each trial.

    Under `object` a view set is of all frames of an object, under `recording` of one recording and split group. There a
    classifier that `answers_recordings` answers each once, by all its frames, and every anchor has its answer; nothing
    is clustered then, except for view sets of fewer frames.

    Args:
        protocol: one of `PROTOCOLS`.
        rngs: a generator for each trial.
    """
    index, cluster, views = table.on(SIDES.index(params.evaluate.side)), params.cluster, classifier.views
    label, anchors, pool = table.label[index], np.flatnonzero(table.anchor[index]), pool_ids(table, index, protocol)
    truth, points = label[anchors], table.points(index)
    whole = protocol == "recording" and classifier.answers_recordings
    frames = int(np.median(np.bincount(pool))) if whole else views
    sizes = [size for size in powers_of_two(views) if size < frames] if classifier.takes_fewer else []
    of_recordings = recording_answers(classifier, temperature, values, pool)[pool[anchors]] if whole else None
    clustered = bool(sizes) or not whole
    scores = pool_scores(points, pool) if clustered and cluster.method == "kmeans" and views > 1 else None
    top, fewer = list[np.ndarray](), {size: list[np.ndarray]() for size in sizes}
    for rng in rngs:
        if clustered:
            sets = ViewSets(cluster_pools(points, pool, views, cluster, rng, scores), pool, views)
            drawn = sets.draw(anchors, rng, cluster.assignment)
            columns = anchor_first(drawn, anchors, rng.spawn(1)[0])  # a separate generator: no other draw changes
            for size, correct in fewer.items():
                part = np.take_along_axis(drawn, columns[:, :size], axis=1)
                correct.append(classifier.view_sets(values, part).argmax(axis=1) == truth)
        logits = classifier.view_sets(values, drawn) if of_recordings is None else of_recordings
        top.append(np.argsort(-logits, axis=1, kind="stable")[:, :TOP])  # ties to the lowest class
    best = np.stack(top)  # (T, A, 3)
    of_fewer, right = {size: np.stack(correct) for size, correct in fewer.items()}, best == truth[:, None]
    return Trials(best[..., 0], right[..., 0], right.any(axis=-1), of_fewer, frames, whole)
