"""Drawing view sets: V frames that are classified together, one from each cluster of a pool.

A pool is the frames of one object or of one recording, divided into V clusters. A view set is drawn around an anchor,
which is the frame of its cluster.
"""

import numpy as np

from tactile_viewgcn.tables.views import Views


def random_clusters(pool: np.ndarray, views: int, rng: np.random.Generator) -> np.ndarray:
    """Cluster int64 (n,), 0 to V - 1, at random and in equal numbers within each pool (n,): the unclustered ablation.

    A view set from such clusters is V different frames of the pool at random.
    """
    order = np.lexsort((rng.random(len(pool)), pool))
    ranked = pool[order]
    rank = np.arange(len(pool)) - np.searchsorted(ranked, ranked)
    cluster = np.empty(len(pool), dtype=np.int64)
    cluster[order] = rank % views
    return cluster


class ViewSets:
    """Clusters that view sets are drawn from.

    A cluster without frames is drawn from its whole pool, so that frames repeat.

    Args:
        cluster: (n,) cluster of each frame in its pool, 0 to V - 1.
        pool: (n,) pool of each frame, 0 to P - 1.
        views: V.

    Attributes:
        empty: bool (P, V), clusters without frames.
    """

    def __init__(self, cluster: np.ndarray, pool: np.ndarray, views: int):
        self.views, self._cluster, self._pool = views, cluster, pool
        cell = pool * views + cluster
        self._members = np.argsort(cell, kind="stable")  # frames by pool, then cluster
        cells = (int(pool.max()) + 1) * views
        count = np.bincount(cell, minlength=cells).reshape(-1, views)
        start = np.concatenate([[0], np.cumsum(count)[:-1]]).reshape(-1, views)
        self.empty = count == 0
        self._start = np.where(self.empty, start[:, :1], start)
        self._count = np.where(self.empty, count.sum(axis=1, keepdims=True), count)

    def draw(self, anchors: np.ndarray, rng: np.random.Generator, assignment: str = "index") -> np.ndarray:
        """View sets int64 (A, V) of frame indices, one for each anchor (A,).

        Args:
            anchors: frame indices.
            rng: for the draw.
            assignment: `anchor` (released code): the anchor first, frames of the other clusters in random order;
                `random`: all in random order; otherwise column i holds a frame of cluster i, as in the paper.
        """
        pool = self._pool[anchors]
        pick = self._start[pool] + (rng.random((len(anchors), self.views)) * self._count[pool]).astype(np.int64)
        sets, anchor_cluster = self._members[pick], self._cluster[anchors]
        rows = np.arange(len(anchors))
        sets[rows, anchor_cluster] = anchors
        if assignment in ("anchor", "random"):
            key = rng.random(sets.shape)
            if assignment == "anchor":
                key[rows, anchor_cluster] = -1
            sets = np.take_along_axis(sets, np.argsort(key, axis=1), axis=1)
        return sets


def sets_of(views: Views, index: np.ndarray, rng: np.random.Generator) -> ViewSets:
    """Clusters of the frames in `index` (k,), at random if nothing is clustered; view sets count them from 0."""
    pool, count = np.unique(views.pool[index], return_inverse=True)[1].ravel(), len(views.viewpoints)
    cluster = views.cluster[index].astype(np.int64) if views.clustered else random_clusters(pool, count, rng)
    return ViewSets(cluster, pool, count)
