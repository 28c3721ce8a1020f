"""Systems that take the maximum of each sensor over a view set, and then ask an estimator."""

from typing import Any

import numpy as np

from tactile_viewgcn.nn.sensor_system import SensorData, SensorSystem, fitted, log_probabilities

SETS = 10  # view sets of each recording and size that the estimator is fitted to


class SensorMaximum(SensorSystem):
    """An estimator of the maximum of the frames' values; `estimator` and `of_frames` are a system's own."""

    def estimator(self, live: np.ndarray) -> Any:
        """The estimator with nothing chosen on the data, for live sensors (H, W)."""
        raise NotImplementedError

    def fit(self, data: SensorData) -> None:
        sets, labels = data.view_sets(SETS)
        values = self.of_frames(data.frames)
        points = np.concatenate([values[of_size].max(axis=1) for of_size in sets])
        self.fitted = fitted(self.estimator(data.live), points, labels)

    def logits(self, values: np.ndarray) -> np.ndarray:
        return log_probabilities(self.all_classes(self.fitted, values.max(axis=1)))
