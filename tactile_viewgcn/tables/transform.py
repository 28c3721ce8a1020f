"""The transform from counts above baseline to network input."""

import numpy as np


def network_input(excess: np.ndarray, transform: str, scale: float) -> np.ndarray:
    """Network input float32 from counts above baseline, of the same shape.

    Args:
        excess: counts above baseline.
        transform: `clip` (released code): clip(x / scale, 0, 1); `log`: log(1 + max(x, 0)); `counts`: x, for systems
            without a network.
        scale: counts at full scale, for `clip` only.
    """
    excess = np.asarray(excess, dtype=np.float32)
    if transform == "clip":
        return np.clip(excess / np.float32(scale), 0, 1)
    return excess if transform == "counts" else np.log1p(np.maximum(excess, 0))


def full_scale(transform: str, scale: float) -> float:
    """Network input of a sensor that reads `scale` counts above baseline."""
    return float(network_input(np.array(scale), transform, scale))
