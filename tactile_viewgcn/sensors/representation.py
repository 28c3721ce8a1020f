"""What the members of a classifier on the sensors make of readings; it is fitted without labels."""

from typing import Annotated, Self

import numpy as np

from tactile_viewgcn.sensors.convolutions import Convolutions, Ridge
from tactile_viewgcn.sensors.estimators import Arrays, Estimator
from tactile_viewgcn.sensors.features import (
    array_maps,
    array_statistics,
    block_weights,
    in_time,
    in_windows,
    is_array,
    pressed,
    unordered,
    with_blocks,
)
from tactile_viewgcn.sensors.forest import FEWEST_TREES, TREES, Forest
from tactile_viewgcn.sensors.kernels import KernelRidge, NormalisedVectors, SupportVectors

#: members that answer single frames, whose probabilities are averaged; and those that take whole recordings alone
OF_FRAMES, OF_RECORDINGS = "kernel", "convolutions"
FARTHEST = 1e15  # scaled reading: its square is in the range of single precision


def reads(member: str) -> str:
    """The member whose points a member reads: `pooled_kernel` reads those of `svm`, all others their own."""
    return "svm" if member == "pooled_kernel" else member


class Representation(Arrays):
    """Scaled readings of the live sensors, and the points of each member.

    Args:
        live: bool (H, W).

    Attributes:
        centre, spread: (F,) of each live sensor: mean and standard deviation of a channel; 0 and the unit of an array.
        convolutions: features of the member of this name; None until they are fitted.
    """

    centre: Annotated[np.ndarray, np.float32, "F"]
    spread: Annotated[np.ndarray, np.float32, "F"]

    def __init__(self, live: np.ndarray):
        self.live, self.is_array = live, is_array(live)
        self.blocks = block_weights(live) if self.is_array else np.zeros((int(live.sum()), 0), dtype=np.float32)
        self.convolutions: Convolutions | None = None

    def fit(self, sample: np.ndarray, unit: float) -> Self:
        """Measure the scale of channels on a sample of frames, counts (n, S); `unit` is that of an array."""
        if self.is_array:
            return self.take(centre=np.zeros(sample.shape[1]), spread=np.full(sample.shape[1], unit))
        centre, spread = sample.mean(axis=0, dtype=np.float64), sample.std(axis=0, dtype=np.float64)
        return self.take(centre=centre, spread=np.where(spread > 0, spread, 1))

    def check(self, features: int) -> None:
        if not (self.spread > 0).all():
            raise ValueError("a sensor's spread is not above 0")

    def scaled(self, counts: np.ndarray) -> np.ndarray:
        """Readings float32 (n, S) of frames, from counts (n, S) above baseline."""
        readings = np.divide(counts - self.centre, self.spread, dtype=np.float64)
        return np.clip(readings, -FARTHEST, FARTHEST).astype(np.float32)

    def points(self, member: str, readings: np.ndarray, *, whole: bool) -> np.ndarray:
        """The member's points (B, F) of scaled readings (B, T, S): whole recordings in time order, or view sets."""
        if member == OF_FRAMES:
            return with_blocks(pressed(readings[:, 0]), self.blocks) if self.is_array else readings[:, 0]
        if member == OF_RECORDINGS:
            assert self.convolutions
            return np.stack([self.convolutions.features(each) for each in readings])
        if self.is_array:
            return array_statistics(readings) if member == "trees" else array_maps(readings, self.blocks)
        readings = readings.astype(np.float64)
        if not whole:
            return unordered(readings)
        return in_time(readings) if member == "trees" else in_windows(readings)

    def estimator(self, member: str, *, quick: bool = False) -> Estimator:
        """The member's estimator, not fitted yet; a quick one has fewer trees."""
        if member == "trees":
            return Forest(FEWEST_TREES if quick else TREES)
        vectors = SupportVectors if self.is_array else NormalisedVectors
        return {"svm": vectors, OF_RECORDINGS: Ridge}.get(member, KernelRidge)()
