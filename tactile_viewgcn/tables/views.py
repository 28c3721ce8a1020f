"""The table of views, data/views.h5: cluster and pool of each frame, viewpoints."""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import BinaryIO

import h5py
import numpy as np

from tactile_viewgcn.files import atomic_write, hdf5_file, readable

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


def write_views(path: str | Path, views: Views) -> None:
    """Write as HDF5, one dataset per attribute."""
    with atomic_write(path) as part, hdf5_file(part) as file:
        for field in fields(views):
            file[field.name] = getattr(views, field.name)


def read_views(path: str | Path | BinaryIO) -> Views:
    """Read a table of `write_views`."""
    with readable(path), h5py.File(path, "r") as file:
        return Views(**{field.name: file[field.name][()] for field in fields(Views)})
