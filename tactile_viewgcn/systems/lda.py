"""Principal components and linear discriminant analysis of single frames."""

from typing import Any

from tactile_viewgcn.sensors.frame_estimator import FrameEstimator
from tactile_viewgcn.sensors.sensor_system import SensorData

COMPONENTS = 50


class LDA(FrameEstimator):
    """Fifty principal components, or as many as there are, then linear discriminant analysis."""

    def estimator(self, data: SensorData) -> Any:
        from sklearn.decomposition import PCA
        from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
        from sklearn.pipeline import make_pipeline

        frames, sensors = data.frames.shape
        components = min(COMPONENTS, frames - 1, sensors)
        return make_pipeline(PCA(components, random_state=data.seed), LinearDiscriminantAnalysis())
