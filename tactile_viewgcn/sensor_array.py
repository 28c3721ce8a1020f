"""Tells a glove with an array of sensors from a glove with channels, few sensors of any kind."""

import numpy as np

LEAST_SIDE = 4  # an array has at least this number of rows, and of columns
LEAST_SENSORS = 64  # an array has at least this number of sensors
LEAST_LIVE = 48  # at least so many of them vary, so that a few dead ones make no difference


def is_array(live: np.ndarray) -> bool:
    """Return whether the sensors are an array.

    An array has 64 sensors or more, in at least four rows and four columns. At least 48 vary.

    Args:
        live: bool (H, W), the sensors whose readings vary.
    """
    is_grid = min(live.shape) >= LEAST_SIDE and live.size >= LEAST_SENSORS
    return is_grid and int(live.sum()) >= LEAST_LIVE
