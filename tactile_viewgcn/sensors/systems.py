"""Systems on the sensors: estimators on single frames, or on what is pooled from a view set.

A system is fitted to `TrainingFrames`. Its `frame_values` are computed of each frame alone, from readings (n, S) in
units to float32 (n, F), and its `logits` (B, classes) of view sets of these values (B, k, F), whatever the order of
views. Its `state_dict` holds tensors and plain values.
"""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from scipy.special import softmax

from tactile_viewgcn.sensors.estimators import Estimator, TrainingFrames

SETS, QUICK_SETS = 10, 4  # view sets of each pool of frames and size that an estimator is fitted to
MOST_VALUES = 1 << 24  # numbers of view sets that are pooled at once
FLOOR = 0.01  # added to the probabilities of an ensemble's members, so that no member's zero is a veto

Points = Callable[[np.ndarray], np.ndarray]


class SensorSystem(Protocol):
    """See the module. It `takes_fewer` views than V where it is fitted to these too, and they cost little."""

    @property
    def takes_fewer(self) -> bool: ...

    def fit(self, data: TrainingFrames) -> "SensorSystem": ...

    def state_dict(self) -> dict[str, Any]: ...

    def load_state_dict(self, state: dict[str, Any], sensors: int, classes: int) -> None: ...

    def frame_values(self, sensors: np.ndarray) -> np.ndarray: ...

    def logits(self, values: np.ndarray) -> np.ndarray: ...


class EstimatorSystem:
    """What the two below share: an estimator for each size of view set.

    Args:
        estimator: makes one, with nothing fitted yet.
        points: readings (n, S) in units to what is pooled.
        pooled: points (B, k, F) of view sets to what the estimator reads, (B, F').
    """

    def __init__(self, estimator: Callable[[], Estimator], points: Points, pooled: Points):
        self.estimator, self.points, self.pooled = estimator, points, pooled
        self.fitted: dict[int, Estimator] = {}

    @property
    def takes_fewer(self) -> bool:
        return 1 in self.fitted

    def state_dict(self) -> dict[str, Any]:
        return {str(size): each.state_dict() for size, each in self.fitted.items()}

    def load_state_dict(self, state: dict[str, Any], sensors: int, classes: int) -> None:
        features = self.pooled(self.points(np.zeros((1, sensors)))[None]).shape[1]
        self.classes = classes
        self.fitted = {
            int(size): self.estimator().load_state_dict(each, features, classes) for size, each in state.items()
        }
        if not self.fitted:
            raise ValueError("a system has no estimator")


class SingleFrames(EstimatorSystem):
    """An estimator that classifies each frame alone; the probabilities of a view set are averaged."""

    def __init__(self, estimator: Callable[[], Estimator], points: Points):
        super().__init__(estimator, points, lambda of_set: of_set[:, 0])

    def fit(self, data: TrainingFrames) -> SensorSystem:
        self.classes = data.classes
        self.fitted = {1: self.estimator().fit(self.points(data.frames), data.labels, data)}
        return self

    def frame_values(self, sensors: np.ndarray) -> np.ndarray:
        (fitted,) = self.fitted.values()
        return probabilities(fitted, self.points(sensors), self.classes)

    def logits(self, values: np.ndarray) -> np.ndarray:
        return log_probabilities(values.mean(axis=1))


class PooledSets(EstimatorSystem):
    """An estimator for each size of view set; a set of a size in between goes to the next smaller one's."""

    def fit(self, data: TrainingFrames) -> SensorSystem:
        sets, labels = data.view_sets(QUICK_SETS if data.quick else SETS)
        values, self.classes = self.points(data.frames), data.classes
        self.fitted = {
            size: self.estimator().fit(self._pooled_sets(values, of_size), labels, data)
            for size, of_size in zip(data.sizes, sets, strict=True)
        }
        return self

    def _pooled_sets(self, values: np.ndarray, sets: np.ndarray) -> np.ndarray:
        """What the estimator reads of view sets (M, k) of indices into values (n, F), in parts that fit memory."""
        parts = -(-sets.size * values.shape[1] // MOST_VALUES)
        return np.concatenate([self.pooled(values[part]) for part in np.array_split(sets, max(1, parts))])

    def frame_values(self, sensors: np.ndarray) -> np.ndarray:
        return self.points(sensors)

    def logits(self, values: np.ndarray) -> np.ndarray:
        size = max((size for size in self.fitted if size <= values.shape[1]), default=min(self.fitted))
        return log_probabilities(probabilities(self.fitted[size], self.pooled(values), self.classes))


def added(logits: list[np.ndarray]) -> np.ndarray:
    """Logits (B, classes) of an ensemble from those of its members; one alone keeps its own."""
    if len(logits) == 1:
        return logits[0]
    return np.log(softmax(np.stack(logits), axis=-1) + FLOOR).sum(axis=0)


def probabilities(fitted: Estimator, points: np.ndarray, classes: int) -> np.ndarray:
    """Probabilities float32 (n, classes) of an estimator; of a class that it was not fitted to they are 0."""
    shares = np.zeros((len(points), classes), dtype=np.float32)
    shares[:, fitted.classes] = fitted.predict_proba(points)
    return shares


def log_probabilities(shares: np.ndarray) -> np.ndarray:
    """Logarithms, of 0 that of the smallest number that single precision holds."""
    return np.log(np.maximum(shares, np.finfo(np.float32).tiny))
