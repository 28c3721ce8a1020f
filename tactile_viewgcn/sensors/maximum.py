"""Systems that take the maximum of each sensor over a view set, and then ask an estimator."""

from typing import Any

import numpy as np

from tactile_viewgcn.sensors.sensor_system import SensorData, SensorSystem, fitted, log_probabilities

SETS = 10  # view sets of each pool of frames and size that the estimator is fitted to


class SensorMaximum(SensorSystem):
    """An estimator, for each size of view set, of the maximum of the frames' values.

    `estimator` and `of_frames` are a system's own. View sets of a size in between go to the next smaller one's.
    """

    def estimator(self, live: np.ndarray) -> Any:
        """The estimator with nothing chosen on the data, for live sensors (H, W)."""
        raise NotImplementedError

    def fit(self, data: SensorData) -> None:
        sets, labels = data.view_sets(SETS)
        values = self.of_frames(data.frames)
        self.fitted = {
            size: fitted(self.estimator(data.live), values[of_size].max(axis=1), labels)
            for size, of_size in zip(data.sizes, sets, strict=True)
        }

    def logits(self, values: np.ndarray) -> np.ndarray:
        estimator = self.fitted[
            max((size for size in self.fitted if size <= values.shape[1]), default=min(self.fitted))
        ]
        return log_probabilities(self.all_classes(estimator, values.max(axis=1)))
