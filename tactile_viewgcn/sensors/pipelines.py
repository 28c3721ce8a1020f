"""The systems on the sensors by name, each a pipeline of scikit-learn on what it reads of the frames."""

from collections.abc import Callable
from typing import Any

import numpy as np

from tactile_viewgcn.sensors.systems import SensorSystem, SetMaximum, SingleFrames, TrainingFrames
from tactile_viewgcn.sensors.unit import above_dead_zone, logarithm

THRESHOLDS = (4.0, 8.0, 16.0)  # units: a sensor is pressed lightly, firmly, hard
COMPONENTS = 50  # of the principal component analysis


def trees() -> SensorSystem:
    """500 extremely randomised trees (Geurts et al. 2006), fully grown."""
    from tactile_viewgcn.sensors.forest import Forest

    return SingleFrames(lambda data: Forest(500, random_state=data.seed), logarithm)


def logistic() -> SensorSystem:
    """Multinomial logistic regression with scikit-learn's penalty, 500 iterations of L-BFGS at most."""
    from sklearn.linear_model import LogisticRegression

    return SingleFrames(lambda data: LogisticRegression(max_iter=500), logarithm)


def knn() -> SensorSystem:
    """Five nearest neighbours, or as many as there are training frames, by the angle between frames."""
    from sklearn.neighbors import KNeighborsClassifier

    return SingleFrames(lambda data: KNeighborsClassifier(min(5, len(data.frames)), metric="cosine"), logarithm)


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


def kernel() -> SensorSystem:
    """Kernel ridge regression on the sensors above the dead zone and on means over blocks of them."""
    return SingleFrames(_kernel_regression, above_dead_zone)


def max_logistic() -> SensorSystem:
    """Logistic regression, with ten times scikit-learn's penalty, on each sensor's maximum against three thresholds."""
    from sklearn.linear_model import LogisticRegression

    return SetMaximum(lambda data: LogisticRegression(C=0.1, max_iter=500), above_thresholds)


def max_kernel() -> SensorSystem:
    """The same regression as `kernel` on the maximum of each sensor."""
    return SetMaximum(_kernel_regression, above_dead_zone)


def max_network() -> SensorSystem:
    """A small residual network on the maximum of each sensor."""
    from tactile_viewgcn.sensors.max_network import MaxNetwork

    return MaxNetwork()


def _kernel_regression(data: TrainingFrames) -> Any:
    from sklearn.pipeline import make_pipeline

    from tactile_viewgcn.sensors.kernels import BlockMeans, KernelClassifier

    return make_pipeline(BlockMeans(data.live), KernelClassifier())


def above_thresholds(sensors: np.ndarray) -> np.ndarray:
    """Whether readings (n, S) in units are above each of three thresholds, float32 (n, 3 S)."""
    return np.concatenate([sensors > threshold for threshold in THRESHOLDS], axis=1).astype(np.float32)


MEMBERS: dict[str, Callable[[], SensorSystem]] = {
    system.__name__: system for system in (trees, logistic, knn, lda, kernel, max_logistic, max_kernel, max_network)
}
