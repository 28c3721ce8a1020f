"""Systems whose estimator classifies each frame alone; the probabilities of a view set are averaged."""

from typing import Any

import numpy as np

from tactile_viewgcn.sensors.sensor_system import SensorData, SensorSystem, fitted, log_probabilities


class FrameEstimator(SensorSystem):
    """An estimator of log(1 + max(x, 0)), x a sensor's reading in units."""

    def estimator(self, data: SensorData) -> Any:
        """The estimator with nothing chosen on the data, for training on the data's frames."""
        raise NotImplementedError

    def points(self, sensors: np.ndarray) -> np.ndarray:
        """What the estimator is given of readings (n, S)."""
        return np.log1p(np.maximum(sensors, 0))

    def fit(self, data: SensorData) -> None:
        self.fitted = fitted(self.estimator(data), self.points(data.frames), data.labels)

    def of_frames(self, sensors: np.ndarray) -> np.ndarray:
        return self.all_classes(self.fitted, self.points(sensors))

    def logits(self, values: np.ndarray) -> np.ndarray:
        return log_probabilities(values.mean(axis=1))
