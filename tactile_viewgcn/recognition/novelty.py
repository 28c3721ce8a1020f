"""Novelty: the distance of a recording's frames from the nearest frames of the training.

A set of frames is described by the mean reading of each sensor. The threshold is a quantile of the distances from each
training recording to the nearest of the others.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from annotated_types import Interval
from pydantic import BeforeValidator, PlainSerializer
from torch import Tensor

from tactile_viewgcn.randomness import by_turns, stream
from tactile_viewgcn.sensors.unit import contact_unit
from tactile_viewgcn.tables.frames import TRAIN, Frames

QUANTILE = 0.99  # of the training recordings' distances
DEAD_ZONE = 1.0  # units; a weaker mean reading counts as noise
SETS = 5  # frame sets of each training recording
MOST_SETS = 2000  # of all training recordings
#: an array in memory, a tensor in a model file
Array = Annotated[
    np.ndarray,
    BeforeValidator(lambda value: value.numpy() if isinstance(value, Tensor) else value),
    PlainSerializer(torch.from_numpy),
]
Unit = Annotated[float, Interval(gt=0, le=1e31)]  # counts


@dataclass(frozen=True)
class Novelty:
    """A detector of frames that are unlike the training's.

    Attributes:
        maps: float32 (M, S) of training sets, see `sensor_map`.
        unit: of a reading, in counts, see `contact_unit`.
        threshold: distance beyond which frames count as unlike the training's.
    """

    maps: Array
    unit: Unit
    threshold: Unit

    def score(self, readings: np.ndarray) -> float:
        """Distance of readings (n, S) in counts above baseline to the nearest training set, 1 at the threshold."""
        new = sensor_map(readings, self.unit)
        return float(np.sqrt(((self.maps - new) ** 2).mean(axis=1).min()) / self.threshold)


def sensor_map(readings: np.ndarray, unit: float) -> np.ndarray:
    """log(1 + max(m - 1, 0)) float32 (S,), m the mean in units over the frames of readings (n, S) in counts."""
    return np.log1p(np.maximum(readings.mean(axis=0) / unit - DEAD_ZONE, 0)).astype(np.float32)


def fit_novelty(frames: Frames, views: int) -> Novelty | None:
    """The detector for sets of `views` frames, fitted to the training side.

    None where there is nothing to compare: no class has two training recordings of that many frames, or all recordings
    are copies.
    """
    from sklearn.metrics import euclidean_distances

    train = frames.on(TRAIN)
    columns = np.stack([frames.label[train], frames.group[train], frames.recording[train]])
    pools, sizes = np.unique(columns, axis=1, return_inverse=True, return_counts=True)[1:]
    members = np.split(train[np.argsort(pools.ravel(), kind="stable")], np.cumsum(sizes)[:-1])
    members = [index for index in members if len(index) >= views]
    classes = np.array([frames.label[index[0]] for index in members], dtype=int)
    used = np.sort(by_turns(classes, stream(0, "novelty"))[:MOST_SETS])
    members, classes = [members[place] for place in used], classes[used]
    if not len(members) or np.bincount(classes).max() < 2:
        return None
    count = max(1, min(SETS, MOST_SETS // len(members)))
    sets = np.concatenate([index[spread_sets(len(index), views, count)] for index in members])
    readings = [frames.inputs(index, "counts")[:, frames.live] for index in sets]
    unit = contact_unit(np.concatenate(readings))
    maps = np.stack([sensor_map(of_set, unit) for of_set in readings])
    distance = euclidean_distances(maps) / maps.shape[1] ** 0.5
    pool, label = np.repeat(np.arange(len(members)), count), np.repeat(classes, count)
    distance[pool[:, None] == pool] = np.inf
    compared = np.bincount(classes)[label] > 1  # sets of classes with several recordings
    threshold = float(np.quantile(distance.min(axis=1)[compared], QUANTILE))
    return Novelty(maps, unit, threshold) if threshold > 0 else None


def spread_sets(count: int, views: int, sets: int = 1) -> np.ndarray:
    """Indices int64 (sets, views) into `count` frames, evenly spread in each row; the rows interleave.

    Frames repeat where there are fewer than `views`.
    """
    places = np.arange(views) + (np.arange(sets)[:, None] + 0.5) / sets
    return (places * count / views).astype(np.int64)
