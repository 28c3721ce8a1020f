"""The table of views, data/views: cluster and pool of each frame, viewpoints."""

from dataclasses import dataclass, replace

import numpy as np

NO_CLUSTER = -1


@dataclass(frozen=True)
class Views:
    """Result of the stage `cluster`.

    Attributes:
        cluster: int16 (n,) of each kept frame; NO_CLUSTER on the test side, and everywhere if nothing is clustered.
        pool: int64 (n,) of each kept frame.
        viewpoints: float64 (V, 3).
    """

    cluster: np.ndarray
    pool: np.ndarray
    viewpoints: np.ndarray

    @property
    def clustered(self) -> bool:
        """Whether any frame has a cluster."""
        return bool((self.cluster != NO_CLUSTER).any())

    def unclustered(self) -> "Views":
        """Copy without clusters."""
        return replace(self, cluster=np.full_like(self.cluster, NO_CLUSTER))
