"""Novelty: how far the frames of a recording are from everything that the classifier was trained on.

A set of frames is described by the mean reading of each sensor. Its score is the distance to the nearest training set.
The threshold is a quantile of the scores that training recordings have when each is compared with the others alone.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval
from pydantic import BeforeValidator
from torch import Tensor

from tactile_viewgcn.randomness import by_turns, stream
from tactile_viewgcn.sensors.unit import contact_unit
from tactile_viewgcn.tables.frames import TRAIN, Frames

QUANTILE = 0.99  # of the training recordings' scores
DEAD_ZONE = 1.0  # units of a mean reading; below it is noise
SETS = 5  # of a training recording
MOST_SETS = 2000
Array = Annotated[np.ndarray, BeforeValidator(Tensor.numpy)]  # a file has it as a tensor
Unit = Annotated[float, Interval(gt=0, le=1e31)]  # counts


@dataclass(frozen=True)
class Novelty:
    """What the score of new frames is computed from.

    Attributes:
        maps: float32 (M, S) of training sets, see `sensor_map`.
        unit: of a reading, in counts, see `contact_unit`.
        threshold: distance beyond which frames are unlike anything seen.
    """

    maps: Array
    unit: Unit
    threshold: Unit

    def score(self, readings: np.ndarray) -> float:
        """Distance of readings (n, S) in counts above baseline to the nearest training set, 1 at the threshold."""
        new = sensor_map(readings, self.unit)
        return float(np.sqrt(((self.maps - new) ** 2).mean(axis=1).min()) / self.threshold)


def sensor_map(readings: np.ndarray, unit: float) -> np.ndarray:
    """log(1 + max(m - 1, 0)) float32 (S,) of the mean m over frames, in units, of readings (n, S) in counts."""
    return np.log1p(np.maximum(readings.mean(axis=0) / unit - DEAD_ZONE, 0)).astype(np.float32)


def fit_novelty(frames: Frames, views: int) -> Novelty | None:
    """The novelty of frames that are unlike the training side's, in sets of `views` frames.

    None where no class has two training recordings with that many frames, or all are copies: there is nothing to
    compare with.
    """
    from sklearn.metrics import euclidean_distances

    train = frames.on(TRAIN)
    places = np.stack([frames.label[train], frames.group[train], frames.recording[train]])
    pools, sizes = np.unique(places, axis=1, return_inverse=True, return_counts=True)[1:]
    members = np.split(train[np.argsort(pools.ravel(), kind="stable")], np.cumsum(sizes)[:-1])
    members = [index for index in members if len(index) >= views]
    classes = np.array([frames.label[index[0]] for index in members], dtype=int)
    some = np.sort(by_turns(classes, stream(0, "novelty"))[:MOST_SETS])
    members, classes = [members[place] for place in some], classes[some]
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
    of_several = np.bincount(classes)[label] > 1  # recordings
    threshold = float(np.quantile(distance.min(axis=1)[of_several], QUANTILE))
    return Novelty(maps, unit, threshold) if threshold > 0 else None


def spread_sets(count: int, views: int, sets: int = 1) -> np.ndarray:
    """Indices int64 (sets, views) into `count` frames: each row is evenly spread, and the rows lie between each other.

    Frames repeat where there are fewer than `views`.
    """
    places = np.arange(views) + (np.arange(sets)[:, None] + 0.5) / sets
    return (places * count / views).astype(np.int64)
