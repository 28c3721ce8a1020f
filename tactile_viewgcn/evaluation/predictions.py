"""The file of every answer of an evaluation, for paired comparisons with other classifiers."""

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from tactile_viewgcn.evaluation.trials import Trials
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.tables.frames import SIDES, Frames


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
