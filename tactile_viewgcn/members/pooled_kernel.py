"""The member `pooled_kernel`: kernel ridge regression on statistics over a recording's frames.

The statistics are the mean and the maximum of each sensor of an array, or statistics of channels.
"""

import numpy as np

from tactile_viewgcn.members import features
from tactile_viewgcn.members.kernels import KernelRidge
from tactile_viewgcn.members.of_readings import MemberOfSets


class PooledKernelMember(MemberOfSets):
    """Turns a recording or a view set into one point, which kernel ridge regression answers."""

    name = "pooled_kernel"

    def estimator(self, *, quick: bool = False) -> KernelRidge:
        """See `MemberOfReadings.estimator`."""
        return KernelRidge()

    def recording_points(self, readings: np.ndarray) -> np.ndarray:
        """See `MemberOfReadings.recording_points`."""
        if self.representation.blocks is None:
            return features.in_windows(readings.astype(np.float64))
        return features.array_maps(readings, self.representation.blocks)

    def set_points(self, readings: np.ndarray) -> np.ndarray:
        """See `MemberOfSets.set_points`."""
        if self.representation.blocks is None:
            return features.unordered(readings.astype(np.float64))
        return features.array_maps(readings, self.representation.blocks)
