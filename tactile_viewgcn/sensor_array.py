"""Whether a glove's sensors are an array, or channels: few sensors of any kind."""

import numpy as np

LEAST_SIDE = 4  # rows, and columns, of an array
LEAST_SENSORS = 64  # live sensors of an array


def is_array(live: np.ndarray) -> bool:
    """Return whether the sensors are an array: 64 or more, in at least four rows and columns.

    Args:
        live: bool (H, W), the sensors whose readings vary.
    """
    return min(live.shape) >= LEAST_SIDE and int(live.sum()) >= LEAST_SENSORS
