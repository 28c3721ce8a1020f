"""Answers to the evaluated set, and their file.

In each trial one view set around each anchor is answered; each whole recording is answered once.
"""

from dataclasses import dataclass, field
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
#: titles of what is answered, by its name in the results, the last one as in use
TITLES = {"object": "object protocol", "recording": "recording protocol", WHOLE: "whole recordings"}
MOST_PROBABLE = 3  # classes that an answer keeps
# attributes of `Trials` that the file has
OF_TRIALS = ("best", "labels", "groups", "recordings", "frames")


@dataclass(frozen=True)
class Trials:
    """Answers of T trials to A view sets, or of one trial to A whole recordings.

    Attributes:
        best: int16 (T, A, 3) the three most probable classes, the first one first; ties to the
            lowest.
        labels: (A,) true class.
        groups: (A,) split group.
        recordings: (A,) name of the recording.
        frames: number of frames of an answer: V, or those of the median recording.
        fewer: bool (T, A), whether the answer is right, by number of views, 1, 2, 4 and so on below
            V: the anchor and other views of its set at random, each time those before and more.
            Empty if the classifier takes V views only.
    """

    best: np.ndarray
    labels: np.ndarray
    groups: np.ndarray
    recordings: np.ndarray
    frames: int
    fewer: dict[int, np.ndarray] = field(default_factory=dict)

    @property
    def correct(self) -> np.ndarray:
        """Whether the most probable class is the true one, bool (T, A)."""
        correct: np.ndarray = self.best[..., 0] == self.labels
        return correct

    @property
    def errors(self) -> np.ndarray:
        """Error rate (T,) of each trial."""
        errors: np.ndarray = 1 - self.correct.mean(axis=1)
        return errors

    @property
    def chance(self) -> float:
        """Return the error of always naming the class that most answers are of."""
        return float(1 - np.bincount(self.labels).max() / len(self.labels))

    def confusion(self, classes: int) -> np.ndarray:
        """Return counts int64 (C, C) over all trials.

        Args:
            classes: their number C.

        Returns:
            A row for each true class, a column for each most probable one.
        """
        cells = self.labels.astype(np.int64) * classes + self.best[..., 0]
        return np.bincount(cells.ravel(), minlength=classes**2).reshape(classes, classes)


def run_trials(
    classifier: Classifier, values: Any, table: Frames, params: Params, protocol: str
) -> Trials:
    """Classify one view set around each anchor of the evaluated set in each trial.

    All classifiers get the same view sets.

    Args:
        classifier: prepared for answers.
        values: (n, ...) of the evaluated set's frames, see `recognition.model_file`.
        table: the kept frames.
        params: of the sections `evaluate` and `cluster`, and the seed.
        protocol: `object`: a view set is of all frames of an object; `recording`: of one recording
            and split group.
    """
    index = table.on(SIDES.index(params.evaluate.side))
    views = classifier.views
    clustering = params.cluster
    anchors = np.flatnonzero(table.anchor[index])
    labels = table.label[index][anchors]
    pool = pool_ids(table, index, protocol)
    points = table.points(index)
    scores = None  # of the frames, by which k-means clusters them in each trial
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
        # a separate generator: no other draw changes
        columns = anchor_first(sets, anchors, rng.spawn(1)[0])
        for size, correct in fewer.items():
            part = np.take_along_axis(sets, columns[:, :size], axis=1)
            correct.append(classifier.view_sets(values, part).argmax(axis=1) == labels)
        best.append(most_probable(classifier.view_sets(values, sets)))
    correct_of = {size: np.stack(correct) for size, correct in fewer.items()}
    return _trials(np.stack(best), table, index[anchors], views, correct_of)


def answer_recordings(classifier: Classifier, values: Any, table: Frames, params: Params) -> Trials:
    """Answer each recording of the evaluated set once, from all its frames.

    A recording of several split groups is answered once for each of them.

    Args:
        classifier: prepared for answers.
        values: (n, ...) of the evaluated set's frames, see `recognition.model_file`.
        table: the kept frames.
        params: its `evaluate.side` is the evaluated set.
    """
    index = table.on(SIDES.index(params.evaluate.side))
    pool = pool_ids(table, index, "recording")
    _, first, counts = np.unique(pool, return_index=True, return_counts=True)
    answers = recording_answers(classifier, None, values, table.points(index), pool)
    best = most_probable(answers)
    return _trials(best[None], table, index[first], int(np.median(counts)))


def most_probable(logits: np.ndarray) -> np.ndarray:
    """Return the most probable classes of logits (A, classes), ties to the lowest.

    Returns:
        int16 (A, 3), or (A, 2) of two classes.
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
    """Return trials whose labels, groups and recordings are those of the frames `index` (A,)."""
    recordings = np.array(table.recordings)[table.recording[index]]
    return Trials(best, table.label[index], table.group[index], recordings, frames, fewer or {})


@dataclass(frozen=True)
class Predictions:
    """Answers to the evaluated set.

    Attributes:
        trials: by the names in `trials.TITLES`.
        classes: (C,) names.
    """

    trials: dict[str, Trials]
    classes: np.ndarray

    @property
    def whole(self) -> Trials:
        """Return the answers to whole recordings."""
        return self.trials[WHOLE]


def write_predictions(path: Path, predictions: Predictions) -> None:
    """Write as .npz: `classes`, and the attributes of `trials` but `fewer` as `NAME.ATTRIBUTE`."""
    arrays: dict[str, Any] = {"classes": predictions.classes}
    for protocol, trials in predictions.trials.items():
        for name in OF_TRIALS:
            arrays[f"{protocol}.{name}"] = getattr(trials, name)
    np.savez_compressed(path, **arrays)


def read_predictions(path: Path | BinaryIO) -> Predictions:
    """Return the content of the file that `write_predictions` wrote."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    protocols = dict.fromkeys(name.partition(".")[0] for name in arrays if "." in name)
    trials = {
        protocol: Trials(*(arrays[f"{protocol}.{name}"] for name in OF_TRIALS))
        for protocol in protocols
    }
    return Predictions(trials, arrays["classes"])
