"""Answers to the evaluated side, to one view set per anchor in each trial and to each whole recording; their file."""

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
#: what is answered, by its name in the results, the last one as in use
ASKED = {"object": "object protocol", "recording": "recording protocol", WHOLE: "whole recordings"}
TOP = 3
# attributes of `Trials` that the file has
OF_TRIALS = ("best", "labels", "groups", "recordings", "frames")


@dataclass(frozen=True)
class Trials:
    """Answers of T trials to A view sets, or of one trial to A whole recordings.

    Attributes:
        best: int16 (T, A, 3) the three most probable classes, the first one first; ties to the
            lowest.
        labels, groups, recordings: (A,) true class, split group and name of the recording.
        frames: number of frames of an answer: V, or those of the median recording.
        fewer: bool (T, A), whether the answer is right, by number of views, 1, 2, 4 and so on below
            V: the anchor and other views of its set at random, each time those before and more.
            Empty if the classifier takes V alone.
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
        return self.best[..., 0] == self.labels

    @property
    def errors(self) -> np.ndarray:
        """Error (T,) of each trial."""
        return 1 - self.correct.mean(axis=1)

    def confusion(self, classes: int) -> np.ndarray:
        """Counts int64 (C, C) over all trials: row the true class, column the most probable one."""
        cells = self.labels.astype(np.int64) * classes + self.best[..., 0]
        return np.bincount(cells.ravel(), minlength=classes**2).reshape(classes, classes)


def run_trials(
    classifier: Classifier, values: Any, table: Frames, params: Params, protocol: str
) -> Trials:
    """Classify one view set around each anchor of the evaluated side in each trial; all classifiers get the same ones.

    Args:
        values: (n, ...) of the evaluated side's frames, see `recognition.model_file`.
        protocol: `object`: a view set is of all frames of an object; `recording`: of one recording
            and split group.
    """
    index, cluster, views = (
        table.on(SIDES.index(params.evaluate.side)),
        params.cluster,
        classifier.views,
    )
    anchors, pool, points = (
        np.flatnonzero(table.anchor[index]),
        pool_ids(table, index, protocol),
        table.points(index),
    )
    labels, number = table.label[index][anchors], PROTOCOLS.index(protocol)
    scores = pool_scores(points, pool) if cluster.method == "kmeans" and views > 1 else None
    sizes = powers_of_two(views)[:-1] if classifier.takes_fewer else ()
    best, fewer = list[np.ndarray](), {size: list[np.ndarray]() for size in sizes}
    for trial in steps(range(params.evaluate.trials), f"{protocol} protocol", "trials"):
        rng = stream(params.seed, "trial", number, trial)
        sets = ViewSets(cluster_pools(points, pool, views, cluster, rng, scores), pool, views)
        drawn = sets.draw(anchors, rng, cluster.assignment)
        # a separate generator: no other draw changes
        columns = anchor_first(drawn, anchors, rng.spawn(1)[0])
        for size, correct in fewer.items():
            part = np.take_along_axis(drawn, columns[:, :size], axis=1)
            correct.append(classifier.view_sets(values, part).argmax(axis=1) == labels)
        best.append(most_probable(classifier.view_sets(values, drawn)))
    right = {size: np.stack(each) for size, each in fewer.items()}
    return _trials(np.stack(best), table, index[anchors], views, right)


def answer_recordings(classifier: Classifier, values: Any, table: Frames, params: Params) -> Trials:
    """Answer each recording of the evaluated side once, from all its frames; one of several split groups once each.

    For the arguments see `run_trials`.
    """
    index = table.on(SIDES.index(params.evaluate.side))
    pool = pool_ids(table, index, "recording")
    _, first, counts = np.unique(pool, return_index=True, return_counts=True)
    best = most_probable(recording_answers(classifier, None, values, table.points(index), pool))
    return _trials(best[None], table, index[first], int(np.median(counts)))


def most_probable(logits: np.ndarray) -> np.ndarray:
    """The three highest classes int16 (A, 3), or all two, of logits (A, classes); ties to the lowest."""
    return np.argsort(-logits, axis=1, kind="stable")[:, :TOP].astype(np.int16)


def _trials(
    best: np.ndarray,
    table: Frames,
    at: np.ndarray,
    frames: int,
    fewer: dict[int, np.ndarray] | None = None,
) -> Trials:
    """Trials whose labels, groups and recordings are those of the frames `at` (A,)."""
    recordings = np.array(table.recordings)[table.recording[at]]
    return Trials(best, table.label[at], table.group[at], recordings, frames, fewer or {})


@dataclass(frozen=True)
class Predictions:
    """Answers to the evaluated side.

    Attributes:
        trials: by the names in `trials.ASKED`.
        classes: (C,) names.
    """

    trials: dict[str, Trials]
    classes: np.ndarray


def write_predictions(path: Path, predictions: Predictions) -> None:
    """Write as .npz: `classes`, and the attributes of `trials` but `fewer` as `NAME.ATTRIBUTE`."""
    arrays: dict[str, Any] = {"classes": predictions.classes}
    for asked, trials in predictions.trials.items():
        arrays |= {f"{asked}.{name}": getattr(trials, name) for name in OF_TRIALS}
    np.savez_compressed(path, **arrays)


def read_predictions(path: Path | BinaryIO) -> Predictions:
    """Read the file that `write_predictions` wrote."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    names = dict.fromkeys(name.partition(".")[0] for name in arrays if "." in name)
    trials = {asked: Trials(*(arrays[f"{asked}.{name}"] for name in OF_TRIALS)) for asked in names}
    return Predictions(trials, arrays["classes"])
