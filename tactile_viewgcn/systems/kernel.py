"""Kernel ridge regression on single frames."""

from typing import Any

import numpy as np

from tactile_viewgcn.sensors.frame_estimator import FrameEstimator
from tactile_viewgcn.sensors.kernel import above_dead_zone, kernel_estimator
from tactile_viewgcn.sensors.sensor_system import SensorData


class Kernel(FrameEstimator):
    """The kernel sees the readings above the dead zone."""

    def estimator(self, data: SensorData) -> Any:
        return kernel_estimator(data.live)

    def points(self, sensors: np.ndarray) -> np.ndarray:
        return above_dead_zone(sensors)
