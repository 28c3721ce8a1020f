"""Multinomial logistic regression on single frames."""

from typing import Any

from tactile_viewgcn.sensors.frame_estimator import FrameEstimator
from tactile_viewgcn.sensors.sensor_system import SensorData


class Logistic(FrameEstimator):
    """Regularised by scikit-learn's default, 500 iterations of L-BFGS at most."""

    def estimator(self, data: SensorData) -> Any:
        from sklearn.linear_model import LogisticRegression

        return LogisticRegression(max_iter=500)
