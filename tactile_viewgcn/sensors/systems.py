"""Systems on the sensors: pipelines of scikit-learn on single frames, on the maximum of a view set, or together.

A system is fitted to `TrainingFrames`. Its `frame_values` are computed of each frame alone, from readings (n, S) in
units to float32 (n, F), and its `logits` (B, classes) of view sets of these values (B, k, F), whatever the order of
views. All that it has learnt is in its attribute `fitted`: estimators, tensors and plain values.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.special import softmax

PACKAGES = ("scikit-learn", "skops")
SETS, QUICK_SETS = 10, 4  # view sets of each pool of frames and size that a pipeline is fitted to
MOST_SETS = 4000  # of a size: a kernel is a matrix of their square
MOST_VALUES = 1 << 24  # numbers of view sets that are pooled at once
FLOOR = 0.01  # added to the probabilities of an ensemble's members, so that no member's zero is a veto


@dataclass(frozen=True)
class TrainingFrames:
    """What a system is fitted to.

    Attributes:
        frames: float32 (n, S) of live sensors, in units.
        labels: int64 (n,) class; classes: number of classes, also of those without frames.
        pools: (n,) what view sets are drawn from: frames of one object in one split group of one recording.
        views: V.
        sizes: numbers of frames in the view sets that the system will answer, rising.
        live: bool (H, W) with S sensors.
        seed: of every random choice.
        quick: a comparison or a calibration, not the final fit: fewer view sets, trees and iterations will do.
    """

    frames: np.ndarray
    labels: np.ndarray
    classes: int
    pools: np.ndarray
    views: int
    sizes: tuple[int, ...]
    live: np.ndarray
    seed: int
    quick: bool = False

    def view_sets(self, count: int) -> tuple[list[np.ndarray], np.ndarray]:
        """Random view sets, each of frames of one pool.

        Args:
            count: of each pool and size; more where a pool has more than `count` times V frames.

        Returns:
            sets: one array (M, k) of frame indices for each size k; and labels (M,).
        """
        rng = np.random.default_rng(self.seed)
        members = [np.flatnonzero(self.pools == pool) for pool in np.unique(self.pools)]
        most = max(1, MOST_SETS // len(members))
        counts = [min(most, max(count, len(frames) // self.views)) for frames in members]
        pools = [frames for frames, of_pool in zip(members, counts, strict=True) for _ in range(of_pool)]
        sets = [
            np.stack([rng.choice(frames, size, replace=len(frames) < size) for frames in pools]) for size in self.sizes
        ]
        return sets, np.array([self.labels[frames[0]] for frames in pools])


class SensorSystem(Protocol):
    """See the module; `packages` are those that a fitted system needs besides torch and NumPy.

    It `takes_fewer` views than V where it is fitted to these too, and they cost little.
    """

    fitted: Any

    @property
    def packages(self) -> tuple[str, ...]: ...

    @property
    def takes_fewer(self) -> bool: ...

    def fit(self, data: TrainingFrames) -> "SensorSystem": ...

    def frame_values(self, sensors: np.ndarray) -> np.ndarray: ...

    def logits(self, values: np.ndarray) -> np.ndarray: ...


@dataclass
class SingleFrames:
    """A pipeline that classifies each frame alone; the probabilities of a view set are averaged.

    Args:
        pipeline: the pipeline for training frames, with nothing fitted yet.
        points: readings (n, S) in units to what the pipeline reads.
    """

    pipeline: Callable[[TrainingFrames], Any]
    points: Callable[[np.ndarray], np.ndarray]
    fitted: Any = None
    packages: tuple[str, ...] = PACKAGES
    takes_fewer = True

    def fit(self, data: TrainingFrames) -> SensorSystem:
        pipeline = fit_pipeline(self.pipeline(data), self.points(data.frames), data.labels)
        self.fitted = {"classes": data.classes, "pipeline": pipeline}
        return self

    def frame_values(self, sensors: np.ndarray) -> np.ndarray:
        return probabilities(self.fitted["pipeline"], self.points(sensors), self.fitted["classes"])

    def logits(self, values: np.ndarray) -> np.ndarray:
        return log_probabilities(values.mean(axis=1))


@dataclass
class PooledSets:
    """A pipeline as in `SingleFrames`, for each size of view set, of what is pooled from the frames' points.

    View sets of a size in between go to the next smaller one's.

    Args:
        pooled: points (B, k, F) of view sets to what the pipeline reads.
    """

    pipeline: Callable[[TrainingFrames], Any]
    points: Callable[[np.ndarray], np.ndarray]
    pooled: Callable[[np.ndarray], np.ndarray]
    fitted: Any = None
    packages: tuple[str, ...] = PACKAGES

    def fit(self, data: TrainingFrames) -> SensorSystem:
        sets, labels = data.view_sets(QUICK_SETS if data.quick else SETS)
        values = self.points(data.frames)
        pipelines = {
            size: fit_pipeline(self.pipeline(data), self._pooled_sets(values, of_size), labels)
            for size, of_size in zip(data.sizes, sets, strict=True)
        }
        self.fitted = {"classes": data.classes, "pipelines": pipelines}
        return self

    @property
    def takes_fewer(self) -> bool:
        return 1 in self.fitted["pipelines"]

    def _pooled_sets(self, values: np.ndarray, sets: np.ndarray) -> np.ndarray:
        """What the pipeline reads of view sets (M, k) of indices into values (n, F), in parts that fit memory."""
        parts = -(-sets.size * values.shape[1] // MOST_VALUES)
        return np.concatenate([self.pooled(values[part]) for part in np.array_split(sets, max(1, parts))])

    def frame_values(self, sensors: np.ndarray) -> np.ndarray:
        return self.points(sensors)

    def logits(self, values: np.ndarray) -> np.ndarray:
        pipelines = self.fitted["pipelines"]
        size = max((size for size in pipelines if size <= values.shape[1]), default=min(pipelines))
        return log_probabilities(probabilities(pipelines[size], self.pooled(values), self.fitted["classes"]))


class Ensemble:
    """The sum of the logarithms of the members' probabilities."""

    def __init__(self, members: list[SensorSystem]):
        self.members = members

    def fit(self, data: TrainingFrames) -> SensorSystem:
        for member in self.members:
            member.fit(data)
        widths = [member.frame_values(data.frames[:1]).shape[1] for member in self.members]
        self._starts = np.cumsum(widths)[:-1].tolist()  # of the values of each member but the first
        return self

    @property
    def packages(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(package for member in self.members for package in member.packages))

    @property
    def takes_fewer(self) -> bool:
        return all(member.takes_fewer for member in self.members)

    @property
    def fitted(self) -> Any:
        return {"members": [member.fitted for member in self.members], "starts": self._starts}

    @fitted.setter
    def fitted(self, fitted: Any) -> None:
        self._starts = fitted["starts"]
        for member, of_member in zip(self.members, fitted["members"], strict=True):
            member.fitted = of_member

    def frame_values(self, sensors: np.ndarray) -> np.ndarray:
        return np.concatenate([member.frame_values(sensors) for member in self.members], axis=1)

    def logits(self, values: np.ndarray) -> np.ndarray:
        parts = np.split(values, self._starts, axis=-1)
        return added([member.logits(part) for member, part in zip(self.members, parts, strict=True)])


def added(logits: list[np.ndarray]) -> np.ndarray:
    """Logits (B, classes) of an ensemble from those of its members; one alone keeps its own."""
    if len(logits) == 1:
        return logits[0]
    return np.log(softmax(np.stack(logits), axis=-1) + FLOOR).sum(axis=0)


def fit_pipeline(pipeline: Any, points: np.ndarray, labels: np.ndarray) -> Any:
    """The pipeline, fitted; that it has reached its limit of iterations is no fault."""
    from sklearn.exceptions import ConvergenceWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return pipeline.fit(points, labels)


def probabilities(pipeline: Any, points: np.ndarray, classes: int) -> np.ndarray:
    """Probabilities float32 (n, classes) of a pipeline; of a class that it was not fitted to they are 0."""
    shares = np.zeros((len(points), classes), dtype=np.float32)
    shares[:, pipeline.classes_] = pipeline.predict_proba(points)
    return shares


def log_probabilities(shares: np.ndarray) -> np.ndarray:
    """Logarithms, of 0 that of the smallest number that single precision holds."""
    return np.log(np.maximum(shares, np.finfo(np.float32).tiny))
