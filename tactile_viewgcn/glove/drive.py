"""The drive of a simulation: what the scenes prescribe over time."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Drive:
    """What the scenes prescribe at K knots one frame apart, linear in between. All arrays are (B, K, ...).

    Attributes:
        posture: (B, K, 5, 2) rad, zero of the joints' springs.
        squeeze: (B, K, 5) N m, torque that closes each finger.
        opposition: (B, K) rad of the thumb.
        position: (B, K, 3) m, where the object is wanted.
        rotation: (B, K, 3) rotation vector of the object, rad.
        load: (B, K, 3) N on the object.
    """

    posture: np.ndarray
    squeeze: np.ndarray
    opposition: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    load: np.ndarray

    def at(self, rows: np.ndarray, time: np.ndarray) -> dict[str, np.ndarray]:
        """Values by name of rows (R,) at times (R,), in frames since the first knot."""
        values_at, last = {}, self.squeeze.shape[1] - 1
        knot = np.minimum(time.astype(int), last - 1)
        fraction = np.minimum(time - knot, 1.0)
        for name, values in vars(self).items():
            before, after = values[rows, knot], values[rows, knot + 1]
            weight = fraction.reshape(-1, *[1] * (before.ndim - 1))
            values_at[name] = before + weight * (after - before)
        return values_at
