"""The table of views, data/views.h5: cluster and pool of each frame, viewpoints."""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import BinaryIO

import h5py
import numpy as np

from tactile_viewgcn.files import atomic_write, readable
from tactile_viewgcn.frames.split import TRAIN
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.views.sampling import ViewSets, random_clusters

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

    def means(self, table: Frames) -> np.ndarray:
        """Mean network input (C, V, H, W) of each class's clusters on the training side, 0 where a cluster is empty."""
        means = np.zeros((len(table.classes), len(self.viewpoints), *table.live.shape), dtype=np.float32)
        for label, column in np.ndindex(means.shape[:2]):
            index = np.flatnonzero((table.label == label) & (table.side == TRAIN) & (self.cluster == column))
            if len(index):
                means[label, column] = table.mean_input(index)
        return means

    def on(self, index: np.ndarray, rng: np.random.Generator) -> ViewSets:
        """Clusters of the frames in `index` (k,), at random if nothing is clustered; view sets count them from 0."""
        pool, views = np.unique(self.pool[index], return_inverse=True)[1].ravel(), len(self.viewpoints)
        cluster = self.cluster[index].astype(np.int64) if self.clustered else random_clusters(pool, views, rng)
        return ViewSets(cluster, pool, views)


def write_views(path: str | Path, views: Views) -> None:
    """Write as HDF5, one dataset per attribute."""
    with atomic_write(path) as part, h5py.File(part, "w") as file:
        for field in fields(views):
            file[field.name] = getattr(views, field.name)


def read_views(path: str | Path | BinaryIO) -> Views:
    """Read the table that `write_views` wrote."""
    with readable(path), h5py.File(path, "r") as file:
        return Views(**{field.name: file[field.name][()] for field in fields(Views)})
