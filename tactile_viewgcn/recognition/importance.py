"""Which sensors, and which moments of a recording, a classifier on the sensors decides by: permutation importance.

Breiman, "Random forests" (Machine Learning 45, 2001): a sensor's readings are exchanged between recordings that were
left out of the fit. The loss of their objects' log-probability is its importance. It is measured on the support vector
machine, which is a candidate for every glove and reads statistics of each sensor in four windows of time.
"""

import numpy as np

from tactile_viewgcn.messages import Note
from tactile_viewgcn.recognition.left_out import LeftOut
from tactile_viewgcn.sensors.examples import TINY, WHOLE
from tactile_viewgcn.sensors.features import OF_WINDOW, WINDOWS, with_blocks
from tactile_viewgcn.sensors.representation import Representation
from tactile_viewgcn.tables.frames import sensor_names

MEMBER = "svm"
BLOCK = 4  # rows and columns of an array whose sensors are exchanged together
NAMED, MOST_ASKED = 3, 100  # sensors; recordings of each fold


def importance(left: LeftOut) -> np.ndarray:
    """Importance (S, 1 + 4) of each live sensor in the whole recording and in each window; of an array (S, 1)."""
    read = left.examples.representation
    groups, rng, count = _sensor_groups(read), np.random.default_rng(0), 0
    moments = 1 if read.is_array else 1 + WINDOWS
    points, labels, loss = left.examples.points(MEMBER, WHOLE), left.examples.labels, np.zeros((len(groups), moments))
    for fold, estimator in left.estimators(MEMBER):
        asked = rng.permutation(np.flatnonzero(fold))[:MOST_ASKED]
        if len(asked) < 2:
            continue
        count += len(asked)
        truth = np.searchsorted(estimator.classes, labels[asked])
        right = _log(estimator.predict_proba(points[asked])[np.arange(len(asked)), truth]).mean()
        for number, sensors in enumerate(groups):
            parts = [_exchanged(points[asked], read, sensors, moment) for moment in range(moments)]
            shares = estimator.predict_proba(np.concatenate(parts)).reshape(moments, len(asked), -1)
            loss[number] += (right - _log(shares[:, np.arange(len(asked)), truth]).mean(axis=1)) * len(asked)
    of_sensor = np.argmax(groups, axis=0)
    return loss[of_sensor] / max(count, 1)


def importance_note(left: LeftOut, channel_names: list[str]) -> list[Note]:
    """A note of the most important sensors, whose value has the importance of all; none where nothing was left out."""
    if not left.answered.any():
        return []
    values, live = importance(left), left.examples.representation.live
    names, order = sensor_names(live, channel_names), np.argsort(-values[:, 0], kind="stable")
    most = "; ".join(f"{names[at]} ({values[at, 0]:.2g})" for at in order[:NAMED].tolist())
    text = f"decided most, by the log-probability that {MEMBER} loses without it: {most}"
    return [Note(text, topic="importance", value={"sensors": names, "importance": values.tolist()})]


def _log(shares: np.ndarray) -> np.ndarray:
    return np.log(np.maximum(shares, TINY))


def _sensor_groups(read: Representation) -> np.ndarray:
    """bool (G, S) sensors that are exchanged together: single channels, or blocks of an array."""
    if not read.is_array:
        return np.eye(len(read.centre), dtype=bool)
    rows, columns = np.nonzero(read.live)
    block = rows // BLOCK * read.live.shape[1] + columns // BLOCK
    return block == np.unique(block)[:, None]


def _exchanged(points: np.ndarray, read: Representation, sensors: np.ndarray, moment: int) -> np.ndarray:
    """Points (n, F) in which some sensors (S,) have the next recording's statistics: of a window, or all for 0."""
    if read.is_array:
        maps = points.reshape(len(points), 2, -1)[:, :, : len(sensors)].copy()
        maps[:, :, sensors] = np.roll(maps, 1, axis=0)[:, :, sensors]
        return np.concatenate([with_blocks(maps[:, kind], read.blocks) for kind in range(2)], axis=1)
    table = points.reshape(len(points), -1, len(sensors)).copy()
    first = table.shape[1] - (WINDOWS + 1 - moment) * OF_WINDOW
    kept = slice(first, first + OF_WINDOW) if moment else slice(None)
    table[:, kept, sensors] = np.roll(table, 1, axis=0)[:, kept, sensors]
    return table.reshape(len(points), -1)
