"""Drawing view sets: frames that are classified together, one from each cluster of a pool.

A pool is the frames that may stand together: those of one object, or of one recording. Its frames fall into V
clusters (`clustering.py`); a view set takes one frame from each, its anchor from the anchor's own cluster.
"""

from dataclasses import dataclass, fields, replace
from pathlib import Path

import h5py
import numpy as np

from tactile_viewgcn.files import readable, whole

NO_CLUSTER = -1


def random_parts(pool: np.ndarray, views: int, rng: np.random.Generator) -> np.ndarray:
    """int64 (n,): each pool dealt out at random into V parts of equal size. The unclustered ablation.

    A view set drawn from such parts is V distinct frames of the pool at random; the parts are dealt out anew
    for every draw.
    """
    order = np.lexsort((rng.random(len(pool)), pool))
    ranked = pool[order]
    rank = np.arange(len(pool)) - np.searchsorted(ranked, ranked)
    parts = np.empty(len(pool), dtype=np.int64)
    parts[order] = rank % views
    return parts


class ViewSets:
    """Clusters to draw view sets from.

    Args:
        cluster: (n,) cluster of each frame in its pool, 0 to V - 1.
        pool: (n,) pool of each frame, 0 to P - 1.
        views: V.
    """

    def __init__(self, cluster: np.ndarray, pool: np.ndarray, views: int):
        self.views, self._cluster, self._pool = views, cluster, pool
        cell = pool * views + cluster
        self._members = np.argsort(cell, kind="stable")  # frames by pool, then cluster
        cells = (int(pool.max()) + 1) * views
        count = np.bincount(cell, minlength=cells).reshape(-1, views)
        start = np.concatenate([[0], np.cumsum(count)[:-1]]).reshape(-1, views)
        self.empty = count == 0  # (P, V)
        # A cluster without frames is drawn from its whole pool: frames repeat, and `empty` counts where.
        self._start = np.where(self.empty, start[:, :1], start)
        self._count = np.where(self.empty, count.sum(axis=1, keepdims=True), count)

    def draw(self, anchors: np.ndarray, rng: np.random.Generator, assignment: str = "index") -> np.ndarray:
        """One view set per anchor: frame indices int64 (A, V).

        `index`: column i holds a frame of cluster i, the anchor in its own cluster's column (the paper).
        `anchor`: the anchor first, the other clusters' frames in random order (the released code).
        `random`: all in random order. Any other: as `index`, the clusters having the numbers they are to have.
        """
        pool = self._pool[anchors]
        pick = self._start[pool] + (rng.random((len(anchors), self.views)) * self._count[pool]).astype(np.int64)
        sets, own = self._members[pick], self._cluster[anchors]
        rows = np.arange(len(anchors))
        sets[rows, own] = anchors
        if assignment in ("anchor", "random"):
            key = rng.random(sets.shape)
            if assignment == "anchor":
                key[rows, own] = -1
            sets = np.take_along_axis(sets, np.argsort(key, axis=1), axis=1)
        return sets


@dataclass(frozen=True)
class Views:
    """What the cluster stage hands on.

    Attributes:
        cluster: int16 (n,) of each kept frame; NO_CLUSTER on the test side, and everywhere without clustering.
        pool: int64 (n,) pool of each kept frame.
        viewpoints: float64 (V, 3).
        references: float64 (V, live sensors), see `assignment.common_references`; zeros where there are none.
    """

    cluster: np.ndarray
    pool: np.ndarray
    viewpoints: np.ndarray
    references: np.ndarray

    @property
    def clustered(self) -> bool:
        return bool((self.cluster != NO_CLUSTER).any())

    def unclustered(self) -> "Views":
        """The same pools and viewpoints without clusters."""
        return replace(self, cluster=np.full_like(self.cluster, NO_CLUSTER))

    def on(self, index: np.ndarray, rng: np.random.Generator) -> ViewSets:
        """The clusters of the frames in `index`, which view sets then number from 0; parts where unclustered."""
        pool, views = np.unique(self.pool[index], return_inverse=True)[1].ravel(), len(self.viewpoints)
        cluster = self.cluster[index].astype(np.int64) if self.clustered else random_parts(pool, views, rng)
        return ViewSets(cluster, pool, views)


def write_views(path: str | Path, views: Views) -> None:
    """Write as HDF5, one dataset per attribute."""
    with whole(path) as part, h5py.File(part, "w") as file:
        for field in fields(views):
            file[field.name] = getattr(views, field.name)


def read_views(path: str | Path) -> Views:
    """What `write_views` wrote."""
    with readable(path), h5py.File(path, "r") as file:
        return Views(**{field.name: file[field.name][()] for field in fields(Views)})
