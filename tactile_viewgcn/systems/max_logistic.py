"""Multinomial logistic regression on which sensors a view set presses at all, lightly, firmly and hard."""

from typing import Any

import numpy as np

from tactile_viewgcn.sensors.maximum import SensorMaximum

THRESHOLDS = (4.0, 8.0, 16.0)  # units


class MaxLogistic(SensorMaximum):
    """Each sensor's maximum against three thresholds; the penalty is ten times scikit-learn's default."""

    def estimator(self, live: np.ndarray) -> Any:
        from sklearn.linear_model import LogisticRegression

        return LogisticRegression(C=0.1, max_iter=500)

    def of_frames(self, sensors: np.ndarray) -> np.ndarray:
        return np.concatenate([sensors > threshold for threshold in THRESHOLDS], axis=1).astype(np.float32)
