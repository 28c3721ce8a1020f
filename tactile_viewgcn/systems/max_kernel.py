"""Kernel ridge regression on the maximum of each sensor over a view set."""

from typing import Any

import numpy as np

from tactile_viewgcn.sensors.kernel import above_dead_zone, kernel_estimator
from tactile_viewgcn.sensors.maximum import SensorMaximum


class MaxKernel(SensorMaximum):
    """The kernel sees the readings above the dead zone."""

    def estimator(self, live: np.ndarray) -> Any:
        return kernel_estimator(live)

    def of_frames(self, sensors: np.ndarray) -> np.ndarray:
        return above_dead_zone(sensors)
