"""Extremely randomised trees (Geurts et al. 2006) on single frames."""

from typing import Any

from tactile_viewgcn.sensors.frame_estimator import FrameEstimator
from tactile_viewgcn.sensors.sensor_system import SensorData


class Trees(FrameEstimator):
    """500 trees, fully grown."""

    def estimator(self, data: SensorData) -> Any:
        from sklearn.ensemble import ExtraTreesClassifier

        return ExtraTreesClassifier(500, random_state=data.seed)
