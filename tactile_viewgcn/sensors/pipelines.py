"""The systems on the sensors, by name: an estimator, and its input from the frames.

Readings are in units of the glove. A dead zone of two units suits sparse, weak readings; a name that ends in `_log` has
log(1 + x) without it. `max_` reads each sensor's maximum over the frames, `statistics_` five statistics of each sensor.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from tactile_viewgcn.sensors.estimators import Logistic
from tactile_viewgcn.sensors.forest import Forest
from tactile_viewgcn.sensors.kernels import KernelRidge, SupportVectors
from tactile_viewgcn.sensors.max_network import MaxNetwork
from tactile_viewgcn.sensors.systems import EstimatorSystem, SensorSystem
from tactile_viewgcn.sensors.unit import above_dead_zone, logarithm

THRESHOLDS = (4.0, 8.0, 16.0)  # units: a sensor is pressed lightly, firmly, hard
ROUNDING = 1e-6  # of a reading in units


def above_thresholds(sensors: np.ndarray) -> np.ndarray:
    """1 where readings (n, S) in units reach each of three thresholds, else 0, float32 (n, 3 S).

    To be equal, but for rounding, counts as reaching: saturated or on-off sensors may all read the lowest threshold.
    """
    reached = [sensors > (1 - ROUNDING) * threshold for threshold in THRESHOLDS]
    return np.concatenate(reached, axis=1).astype(np.float32)


def maximum(points: np.ndarray) -> np.ndarray:
    """Maximum (B, F) over the points (B, k, F) of view sets."""
    return points.max(axis=1)


def direction(points: np.ndarray) -> np.ndarray:
    """Maximum (B, F) over the points (B, k, F) of view sets, divided by its length where that is not 0."""
    largest = points.max(axis=1)
    length = np.linalg.norm(largest, axis=1, keepdims=True)
    return largest / np.where(length > 0, length, 1)


def statistics(points: np.ndarray) -> np.ndarray:
    """Mean, standard deviation, maximum, minimum and median (B, 5 F) over the points (B, k, F) of view sets."""
    parts = [points.mean(axis=1), points.std(axis=1), points.max(axis=1), points.min(axis=1), np.median(points, axis=1)]
    return np.concatenate(parts, axis=1)


MEMBERS: dict[str, Callable[[], SensorSystem]] = {
    "trees": partial(EstimatorSystem, Forest, logarithm),
    "logistic": partial(EstimatorSystem, Logistic, logarithm),
    "kernel": partial(EstimatorSystem, KernelRidge, above_dead_zone),
    "kernel_log": partial(EstimatorSystem, KernelRidge, logarithm),
    "svm": partial(EstimatorSystem, SupportVectors, above_dead_zone),
    "svm_log": partial(EstimatorSystem, SupportVectors, logarithm),
    "max_logistic": partial(EstimatorSystem, partial(Logistic, C=0.1), above_thresholds, maximum),
    "max_kernel": partial(EstimatorSystem, KernelRidge, above_dead_zone, maximum),
    "max_kernel_log": partial(EstimatorSystem, KernelRidge, logarithm, maximum),
    "max_kernel_cosine": partial(EstimatorSystem, KernelRidge, above_dead_zone, direction),
    "max_svm": partial(EstimatorSystem, SupportVectors, above_dead_zone, maximum),
    "max_svm_log": partial(EstimatorSystem, SupportVectors, logarithm, maximum),
    "max_network": MaxNetwork,
    "statistics_trees": partial(EstimatorSystem, Forest, logarithm, statistics),
    "statistics_svm": partial(EstimatorSystem, SupportVectors, logarithm, statistics),
}
