"""Systems on the sensors: estimators on single frames, or on values that are pooled from a view set.

A system is fitted to `TrainingFrames`. `frame_values` makes float32 (n, F) of readings (n, S) in units, of each frame
alone. `logits` makes (B, classes) of view sets of these values (B, k, F), in whatever order the views are. `state_dict`
holds tensors and plain values; `load_state_dict` takes it over for the sensors `live`, bool (H, W), and a number of
classes. A system `takes_fewer` views than V where it was fitted to fewer, too, and they cost little.
"""

from collections.abc import Callable
from typing import Any, Self

import numpy as np
from scipy.special import softmax

from tactile_viewgcn.sensors.estimators import Estimator, TrainingFrames
from tactile_viewgcn.sensors.max_network import MaxNetwork

SETS, QUICK_SETS = 10, 4  # view sets of each pool and size that an estimator is fitted to
MOST_VALUES = 1 << 24  # numbers in the view sets that are pooled at once
FLOOR = 0.01  # added to the probabilities of an ensemble's members, so that no member's zero is a veto

Points = Callable[[np.ndarray], np.ndarray]


class EstimatorSystem:
    """One estimator of single frames, whose probabilities are averaged; or one for each size of pooled view sets.

    A view set of a size in between is answered by the estimator of the next smaller size.

    Args:
        estimator: makes an estimator that is not fitted yet.
        points: function from readings (n, S) in units to points (n, F).
        pooled: function from points (B, k, F) of view sets to the estimator's input (B, F'); None for single frames.
    """

    def __init__(self, estimator: Callable[[], Estimator], points: Points, pooled: Points | None = None):
        self.estimator, self.points, self.pooled = estimator, points, pooled
        self.fitted: dict[int, Estimator] = {}

    @property
    def takes_fewer(self) -> bool:
        return 1 in self.fitted

    def fit(self, data: TrainingFrames) -> Self:
        points, self.classes = self.points(data.frames), data.classes
        if self.pooled is None:
            self.fitted = {1: self.estimator().fit(points, data.labels, data)}
            return self
        self.fitted, (sets, labels) = {}, data.view_sets(QUICK_SETS if data.quick else SETS)
        for size, of_size in zip(data.sizes, sets, strict=True):
            count = max(1, -(-of_size.size * points.shape[1] // MOST_VALUES))  # parts that fit memory
            pooled = [self.pooled(points[part]) for part in np.array_split(of_size, count)]
            self.fitted[size] = self.estimator().fit(np.concatenate(pooled), labels, data)
        return self

    def state_dict(self) -> dict[str, Any]:
        return {str(size): each.state_dict() for size, each in self.fitted.items()}

    def load_state_dict(self, state: dict[str, Any], live: np.ndarray, classes: int) -> None:
        points, self.classes = self.points(np.zeros((1, live.sum()))), classes
        features = (self.pooled(points[None]) if self.pooled else points).shape[1]
        for size, each in state.items():
            self.fitted[int(size)] = self.estimator().load_state_dict(each, features, classes)
        if not self.fitted:
            raise ValueError("a system has no estimator")

    def frame_values(self, sensors: np.ndarray) -> np.ndarray:
        points = self.points(sensors)
        return points if self.pooled else self._probabilities(1, points)

    def logits(self, values: np.ndarray) -> np.ndarray:
        """Log-probabilities; a probability of 0 counts as the smallest normal number of single precision."""
        if self.pooled:
            size = max((size for size in self.fitted if size <= values.shape[1]), default=min(self.fitted))
            shares = self._probabilities(size, self.pooled(values))
        else:
            shares = values.mean(axis=1)
        return np.log(np.maximum(shares, np.finfo(np.float32).tiny))

    def _probabilities(self, size: int, points: np.ndarray) -> np.ndarray:
        """Probabilities float32 (n, classes) by the estimator of a size; 0 for a class that it was not fitted to."""
        fitted, shares = self.fitted[size], np.zeros((len(points), self.classes), dtype=np.float32)
        shares[:, fitted.classes] = fitted.predict_proba(points)
        return shares


SensorSystem = EstimatorSystem | MaxNetwork


def added(logits: list[np.ndarray]) -> np.ndarray:
    """Logits (B, classes) of an ensemble from those of its members; a single member's are returned as they are."""
    if len(logits) == 1:
        return logits[0]
    return np.log(softmax(np.stack(logits), axis=-1) + FLOOR).sum(axis=0)
