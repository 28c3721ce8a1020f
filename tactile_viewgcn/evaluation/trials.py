"""Answers to the evaluated set, and the file that holds them.

In each trial one view set around each anchor is answered. Each whole recording is answered once.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from tactile_viewgcn.params import Params
from tactile_viewgcn.progress import steps
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.calibration import Classifier, recording_answers
from tactile_viewgcn.tables.frames import SIDES, Frames
from tactile_viewgcn.views.clustering import cluster_pools, pool_ids, pool_scores
from tactile_viewgcn.views.sampling import ViewSets, anchor_first, powers_of_two

PROTOCOLS = ("object", "recording")
WHOLE = "whole"
#: titles of what is answered, by its name in the results; the last is what a user gets
TITLES = {"object": "object protocol", "recording": "recording protocol", WHOLE: "whole recordings"}
MOST_PROBABLE = 3  # classes that an answer keeps
# attributes of `Trials` that the file holds
OF_TRIALS = ("best", "labels", "groups", "recordings", "frames")
PROBABILITIES = "probabilities"  # an attribute that the file holds for whole recordings only


@dataclass(frozen=True)
class Trials:
    """Answers of T trials to A view sets, or of one trial to A whole recordings.

    Attributes:
        best: int16 (T, A, 3) the three most probable classes, the most probable first. Ties go to
            the lowest class.
        labels: (A,) true class.
        groups: (A,) split group.
        recordings: (A,) name of the recording.
        frames: number of frames of an answer: V, or the median length of the recordings.
        fewer: bool (T, A), whether the answer is right, by number of views: 1, 2, 4 and so on below
            V. The views are the anchor and random other views of its set; a larger number adds
            views to the smaller one. Empty if the classifier takes V views only.
        probabilities: float32 (A, classes) of the answers to whole recordings. None for view sets,
            and for answers of an earlier version.
    """

    best: np.ndarray
    labels: np.ndarray
    groups: np.ndarray
    recordings: np.ndarray
    frames: int
    fewer: dict[int, np.ndarray] = field(default_factory=dict)
    probabilities: np.ndarray | None = None

    @property
    def correct(self) -> np.ndarray:
        """Return whether the most probable class is the true class, bool (T, A)."""
        correct: np.ndarray = self.best[..., 0] == self.labels
        return correct

    @property
    def errors(self) -> np.ndarray:
        """Return the error rate (T,) of each trial."""
        errors: np.ndarray = 1 - self.correct.mean(axis=1)
        return errors

    @property
    def chance(self) -> float:
        """Return the error rate of always naming the most frequent true class."""
        return float(1 - np.bincount(self.labels).max() / len(self.labels))

    def confusion(self, classes: int) -> np.ndarray:
        """Return counts int64 (C, C) over all trials.

        Args:
            classes: number C of classes.

        Returns:
            A row for each true class, and a column for each most probable class.
        """
        cells = self.labels.astype(np.int64) * classes + self.best[..., 0]
        return np.bincount(cells.ravel(), minlength=classes**2).reshape(classes, classes)


def run_trials(
    classifier: Classifier, values: Any, table: Frames, params: Params, protocol: str
) -> Trials:
    """Classify one view set around each anchor of the evaluated set in each trial.

    All classifiers get the same view sets.

    Args:
        classifier: is prepared for answers.
        values: (n, ...) the classifier's values of the evaluated set's frames, see `Classifier`.
        table: the kept frames.
        params: the sections `evaluate` and `cluster`, and the seed.
        protocol: `object` draws a view set from all frames of an object, `recording` from one
            recording and split group.
    """
    index = table.on(SIDES.index(params.evaluate.side))
    views = classifier.views
    clustering = params.cluster
    anchors = np.flatnonzero(table.anchor[index])
    labels = table.label[index][anchors]
    pool = pool_ids(table, index, protocol)
    points = table.points(index)
    scores = None  # k-means clusters the frames by their scores in each trial
    if clustering.method == "kmeans" and views > 1:
        scores = pool_scores(points, pool)
    best: list[np.ndarray] = []
    fewer: dict[int, list[np.ndarray]] = {}
    if classifier.takes_fewer:
        fewer = {size: [] for size in powers_of_two(views)[:-1]}
    for trial in steps(range(params.evaluate.trials), f"{protocol} protocol", "trials"):
        rng = stream(params.seed, "trial", PROTOCOLS.index(protocol), trial)
        clusters = cluster_pools(points, pool, views, clustering, rng, scores)
        sets = ViewSets(clusters, pool, views).draw(anchors, rng, clustering.assignment)
        # a separate generator, so that no other draw changes
        columns = anchor_first(sets, anchors, rng.spawn(1)[0])
        for size, correct in fewer.items():
            part = np.take_along_axis(sets, columns[:, :size], axis=1)
            correct.append(classifier.view_sets(values, part).argmax(axis=1) == labels)
        best.append(most_probable(classifier.view_sets(values, sets)))
    correct_of = {size: np.stack(correct) for size, correct in fewer.items()}
    return _trials(np.stack(best), table, index[anchors], views, correct_of)


def answer_recordings(
    classifier: Classifier,
    values: Any,
    table: Frames,
    params: Params,
    *,
    temperature: float | None,
) -> Trials:
    """Answer each recording of the evaluated set once, from all its frames.

    A recording of several split groups is answered once for each of them.

    Args:
        classifier: is prepared for answers.
        values: (n, ...) the classifier's values of the evaluated set's frames, see `Classifier`.
        table: the kept frames.
        params: `evaluate.side`, which names the evaluated set.
        temperature: calibrates the probabilities; None if they are not calibrated.
    """
    index = table.on(SIDES.index(params.evaluate.side))
    pool = pool_ids(table, index, "recording")
    _, first, counts = np.unique(pool, return_index=True, return_counts=True)
    answers = recording_answers(classifier, temperature, values, table.points(index), pool)
    best = most_probable(answers)
    trials = _trials(best[None], table, index[first], int(np.median(counts)))
    return replace(trials, probabilities=np.exp(answers).astype(np.float32))


def most_probable(logits: np.ndarray) -> np.ndarray:
    """Return the most probable classes of logits (A, classes); ties go to the lowest class.

    Returns:
        int16 (A, 3), or (A, 2) if there are two classes.
    """
    order = np.argsort(-logits, axis=1, kind="stable")
    return order[:, :MOST_PROBABLE].astype(np.int16)


def _trials(
    best: np.ndarray,
    table: Frames,
    index: np.ndarray,
    frames: int,
    fewer: dict[int, np.ndarray] | None = None,
) -> Trials:
    """Return trials that have the labels, groups and recordings of the frames `index` (A,)."""
    recordings = np.array(table.recordings)[table.recording[index]]
    return Trials(best, table.label[index], table.group[index], recordings, frames, fewer or {})


@dataclass(frozen=True)
class Predictions:
    """Answers to the evaluated set.

    Attributes:
        trials: by the names in `trials.TITLES`.
        classes: (C,) names of the classes.
    """

    trials: dict[str, Trials]
    classes: np.ndarray

    @property
    def whole(self) -> Trials:
        """Return the answers to whole recordings."""
        return self.trials[WHOLE]


def write_predictions(path: Path, predictions: Predictions) -> None:
    """Write the predictions as .npz, without the attribute `fewer` of the trials.

    The file holds `classes`, and the attributes of the trials as `NAME.ATTRIBUTE`.
    """
    arrays: dict[str, Any] = {"classes": predictions.classes}
    for protocol, trials in predictions.trials.items():
        for name in OF_TRIALS:
            arrays[f"{protocol}.{name}"] = getattr(trials, name)
        if trials.probabilities is not None:
            arrays[f"{protocol}.{PROBABILITIES}"] = trials.probabilities
    np.savez_compressed(path, **arrays)


def read_predictions(path: Path | BinaryIO) -> Predictions:
    """Return the content of the file that `write_predictions` wrote."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    protocols = dict.fromkeys(name.partition(".")[0] for name in arrays if "." in name)
    trials = {
        protocol: Trials(
            **{name: arrays[f"{protocol}.{name}"] for name in OF_TRIALS},
            probabilities=arrays.get(f"{protocol}.{PROBABILITIES}"),
        )
        for protocol in protocols
    }
    return Predictions(trials, arrays["classes"])
