"""Trials on the evaluated side, each of which clusters it anew and classifies one view set per anchor; their file."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from tqdm import tqdm

from tactile_viewgcn.files import atomic_write
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
    """Answers of T trials to A anchors under one protocol.

    Attributes:
        best: int64 (T, A, 3) the three most probable classes, the first one first; ties to the lowest.
        truth: (A,) true classes.
        fewer: bool (T, A), whether the answer is right, by number of views, 1, 2, 4 and so on below V: the anchor and
            other views of its set at random, each time those before and more. Empty if the classifier takes V alone.
        frames: number of frames of an answer: V, or the median of the recordings that are answered `whole`.
    """

    best: np.ndarray
    truth: np.ndarray
    fewer: dict[int, np.ndarray] = field(default_factory=dict)
    frames: int = 1
    whole: bool = False


def run_trials(
    classifier: Classifier,
    values: Any,
    table: Frames,
    params: Params,
    protocol: str,
    temperature: float | None = None,
) -> Trials:
    """Classify one view set around each anchor of the evaluated side in each trial; all classifiers get the same ones.

    Under `object` a view set is of all frames of an object, under `recording` of one recording and split group. There a
    classifier that `answers_recordings` answers each once, by all its frames, and every anchor has its answer; nothing
    is clustered then, except for view sets of fewer frames.

    Args:
        values: (n, ...) of the evaluated side's frames, see `recognition.classifier`.
        protocol: one of `PROTOCOLS`.
        temperature: of the classifier, if it is calibrated.
    """
    index, cluster, views = table.on(SIDES.index(params.evaluate.side)), params.cluster, classifier.views
    anchors, pool, points = np.flatnonzero(table.anchor[index]), pool_ids(table, index, protocol), table.points(index)
    truth, number = table.label[index][anchors], PROTOCOLS.index(protocol)
    whole = protocol == "recording" and classifier.answers_recordings
    frames = int(np.median(np.bincount(pool))) if whole else views
    sizes = [size for size in powers_of_two(views) if size < frames] if classifier.takes_fewer else []
    of_recordings = recording_answers(classifier, temperature, values, pool)[pool[anchors]] if whole else None
    clustered = bool(sizes) or not whole
    scores = pool_scores(points, pool) if clustered and cluster.method == "kmeans" and views > 1 else None
    best, fewer = list[np.ndarray](), {size: list[np.ndarray]() for size in sizes}
    for trial in tqdm(range(params.evaluate.trials), desc=f"evaluate by {protocol}", unit="trial", disable=None):
        rng = stream(params.seed, "trial", number, trial)
        if clustered:
            sets = ViewSets(cluster_pools(points, pool, views, cluster, rng, scores), pool, views)
            drawn = sets.draw(anchors, rng, cluster.assignment)
            columns = anchor_first(drawn, anchors, rng.spawn(1)[0])  # a separate generator: no other draw changes
            for size, correct in fewer.items():
                part = np.take_along_axis(drawn, columns[:, :size], axis=1)
                correct.append(classifier.view_sets(values, part).argmax(axis=1) == truth)
        logits = classifier.view_sets(values, drawn) if of_recordings is None else of_recordings
        best.append(np.argsort(-logits, axis=1, kind="stable")[:, :TOP])
    return Trials(np.stack(best), truth, {size: np.stack(each) for size, each in fewer.items()}, frames, whole)


@dataclass(frozen=True)
class Predictions:
    """Answers to A view sets in T trials.

    Attributes:
        predicted: by protocol, int16 (T, A) predicted class.
        labels, groups: (A,) true class and split group of the anchors; recordings: (A,) name of their recording.
        classes: (C,) names.
    """

    predicted: dict[str, np.ndarray]
    labels: np.ndarray
    groups: np.ndarray
    recordings: np.ndarray
    classes: np.ndarray

    def errors(self, protocol: str) -> np.ndarray:
        """Error (T,) of each trial."""
        return 1 - (self.predicted[protocol] == self.labels).mean(axis=1)

    def confusion(self, protocol: str) -> np.ndarray:
        """Counts int64 (C, C) over all trials: row the true class, column the predicted one."""
        classes, predicted = len(self.classes), self.predicted[protocol]
        cells = np.broadcast_to(self.labels.astype(np.int64), predicted.shape) * classes + predicted
        return np.bincount(cells.ravel(), minlength=classes**2).reshape(classes, classes)


def predictions_of(protocols: dict[str, Trials], table: Frames, side: str) -> Predictions:
    """The answers of the trials of each protocol on one side of the table."""
    index = table.on(SIDES.index(side))
    anchors = index[table.anchor[index]]
    return Predictions(
        {protocol: trials.best[..., 0].astype(np.int16) for protocol, trials in protocols.items()},
        table.label[anchors],
        table.group[anchors],
        np.array(table.recordings)[table.recording[anchors]],
        np.array(table.classes),
    )


def write_predictions(path: Path, predictions: Predictions) -> None:
    """Write as .npz: the attributes, `predicted` as one array `predicted.PROTOCOL` each."""
    arrays = dict(vars(predictions))
    arrays |= {f"predicted.{protocol}": answers for protocol, answers in arrays.pop("predicted").items()}
    with atomic_write(path) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)


def read_predictions(path: Path | BinaryIO) -> Predictions:
    """Read the file that `write_predictions` wrote."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    prefix = "predicted."
    predicted = {name.removeprefix(prefix): arrays.pop(name) for name in list(arrays) if name.startswith(prefix)}
    return Predictions(predicted, **arrays)
