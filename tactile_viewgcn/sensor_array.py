"""Tells a glove with an array of sensors from a glove with channels, few sensors of any kind."""

import numpy as np

LEAST_SIDE = 4  # an array has at least this number of rows, and of columns
LEAST_SENSORS = 64  # an array has at least this number of live sensors


def is_array(live: np.ndarray) -> bool:
    """Return whether the sensors are an array: 64 or more, in at least four rows and columns.

    Args:
        live: bool (H, W), the sensors whose readings vary.
    """
    return min(live.shape) >= LEAST_SIDE and int(live.sum()) >= LEAST_SENSORS
