"""The systems on the sensors by name, each a pipeline of scikit-learn on what it reads of the frames.

Readings are in units of the glove. Below two units is a dead zone, made for sparse, weak readings; a name that ends in
`_log` is a system without it, on log(1 + x).
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from tactile_viewgcn.sensors.systems import PooledSets, SensorSystem, SingleFrames, TrainingFrames
from tactile_viewgcn.sensors.unit import above_dead_zone, logarithm

THRESHOLDS = (4.0, 8.0, 16.0)  # units: a sensor is pressed lightly, firmly, hard
ROUNDING = 1e-6  # of a reading in units
COMPONENTS = 50  # of the principal component analysis
TREES, FEWEST_TREES = 500, 100
ITERATIONS, QUICK_ITERATIONS = 500, 50  # of L-BFGS
MOST_LEAF_VALUES = 60_000_000  # of a forest, probabilities of classes in leaves: 0.5 GB

Points = Callable[[np.ndarray], np.ndarray]


def trees() -> SensorSystem:
    """Extremely randomised trees (Geurts et al. 2006), fully grown."""
    return SingleFrames(_forest, logarithm)


def logistic() -> SensorSystem:
    """Multinomial logistic regression with scikit-learn's penalty, 500 iterations of L-BFGS at most."""
    return SingleFrames(lambda data: _logistic_regression(data, 1.0), logarithm)


def lda() -> SensorSystem:
    """Fifty principal components, or as many as there are, then linear discriminant analysis."""
    from sklearn.decomposition import PCA
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
    from sklearn.pipeline import make_pipeline

    return SingleFrames(
        lambda data: make_pipeline(
            PCA(min(COMPONENTS, len(data.frames) - 1, data.frames.shape[1]), random_state=data.seed),
            LinearDiscriminantAnalysis(),
        ),
        logarithm,
    )


def kernel(points: Points = above_dead_zone) -> SensorSystem:
    """Kernel ridge regression on the sensors and on means over blocks of them."""
    return SingleFrames(_kernel_regression, points)


def svm(points: Points = above_dead_zone) -> SensorSystem:
    """A support vector machine with a Gaussian kernel."""
    return SingleFrames(_support_vectors, points)


def max_logistic() -> SensorSystem:
    """Logistic regression, with ten times scikit-learn's penalty, on each sensor's maximum against three thresholds."""
    return PooledSets(lambda data: _logistic_regression(data, 0.1), above_thresholds, maximum)


def max_kernel(points: Points = above_dead_zone) -> SensorSystem:
    """The same regression as `kernel` on the maximum of each sensor."""
    return PooledSets(_kernel_regression, points, maximum)


def max_kernel_cosine() -> SensorSystem:
    """`max_kernel` on maxima divided by their length, which a session that reads stronger or weaker does not change."""
    return PooledSets(_kernel_regression, above_dead_zone, direction)


def max_svm(points: Points = above_dead_zone) -> SensorSystem:
    """`svm` on the maximum of each sensor."""
    return PooledSets(_support_vectors, points, maximum)


def max_network() -> SensorSystem:
    """A small residual network on the maximum of each sensor."""
    from tactile_viewgcn.sensors.max_network import MaxNetwork

    return MaxNetwork()


def statistics_trees() -> SensorSystem:
    """`trees` on five statistics of each sensor over the frames."""
    return PooledSets(_forest, logarithm, statistics)


def statistics_svm() -> SensorSystem:
    """`svm` on five statistics of each sensor over the frames."""
    return PooledSets(_support_vectors, logarithm, statistics)


def _forest(data: TrainingFrames) -> Any:
    """500 trees, or as few as 100 where leaves would hold more than 60 million numbers."""
    from tactile_viewgcn.sensors.forest import Forest

    fitting = MOST_LEAF_VALUES // (len(data.frames) * data.classes)
    trees = FEWEST_TREES if data.quick else int(np.clip(fitting, FEWEST_TREES, TREES))
    return Forest(trees, random_state=data.seed)


def _logistic_regression(data: TrainingFrames, C: float) -> Any:
    from sklearn.linear_model import LogisticRegression

    return LogisticRegression(C=C, max_iter=QUICK_ITERATIONS if data.quick else ITERATIONS)


def _kernel_regression(data: TrainingFrames) -> Any:
    from sklearn.pipeline import make_pipeline

    from tactile_viewgcn.sensors.kernels import BlockMeans, KernelClassifier

    return make_pipeline(BlockMeans(data.live), KernelClassifier(seed=data.seed))


def _support_vectors(data: TrainingFrames) -> Any:
    from tactile_viewgcn.sensors.support_vectors import SupportVectors

    return SupportVectors(seed=data.seed)


def above_thresholds(sensors: np.ndarray) -> np.ndarray:
    """Whether readings (n, S) in units reach each of three thresholds, float32 (n, 3 S).

    All that a glove's pressed sensors read may be the lowest threshold, where they are saturated or tell contact alone.
    """
    reached = [sensors > (1 - ROUNDING) * threshold for threshold in THRESHOLDS]
    return np.concatenate(reached, axis=1).astype(np.float32)


def maximum(points: np.ndarray) -> np.ndarray:
    """Points (B, k, F) of view sets to their maximum (B, F)."""
    return points.max(axis=1)


def direction(points: np.ndarray) -> np.ndarray:
    """Points (B, k, F) of view sets to their maximum (B, F), divided by its length where that is not 0."""
    largest = points.max(axis=1)
    length = np.linalg.norm(largest, axis=1, keepdims=True)
    return largest / np.where(length > 0, length, 1)


def statistics(points: np.ndarray) -> np.ndarray:
    """Mean, standard deviation, maximum, minimum and median (B, 5 F) of points (B, k, F) of view sets."""
    parts = [points.mean(axis=1), points.std(axis=1), points.max(axis=1), points.min(axis=1), np.median(points, axis=1)]
    return np.concatenate(parts, axis=1)


MEMBERS: dict[str, Callable[[], SensorSystem]] = {
    system.__name__: system
    for system in (
        trees, logistic, lda, kernel, svm, max_logistic, max_kernel, max_kernel_cosine, max_svm, max_network,
        statistics_trees, statistics_svm,
    )
} | {f"{system.__name__}_log": partial(system, logarithm) for system in (kernel, svm, max_kernel, max_svm)}  # fmt: skip
