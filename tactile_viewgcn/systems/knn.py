"""Nearest neighbours of single frames."""

from typing import Any

from tactile_viewgcn.sensors.frame_estimator import FrameEstimator
from tactile_viewgcn.sensors.sensor_system import SensorData


class NearestNeighbours(FrameEstimator):
    """Five neighbours, or as many as there are training frames, by the angle between frames."""

    def estimator(self, data: SensorData) -> Any:
        from sklearn.neighbors import KNeighborsClassifier

        return KNeighborsClassifier(min(5, len(data.frames)), metric="cosine")
