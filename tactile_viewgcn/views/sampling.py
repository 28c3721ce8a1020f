"""Draw view sets: V frames that are classified together, one from each cluster of a pool.

A pool is the frames of one object or recording, divided into V clusters. Each view set is drawn
around an anchor, one of the frames that `Frames` marks as such. The anchor represents its own
cluster.
"""

import numpy as np

from tactile_viewgcn.tables.frames import Views


def random_clusters(pool: np.ndarray, views: int, rng: np.random.Generator) -> np.ndarray:
    """Return a random cluster int64 (n,), 0 to V - 1, for each frame: the unclustered ablation.

    The sizes of the clusters of a pool differ by one at most. A view set from random clusters is V
    different frames of the pool, chosen at random.

    Args:
        pool: (n,) pool of each frame.
        views: V.
        rng: draws the order of the frames.
    """
    order = np.lexsort((rng.random(len(pool)), pool))
    ranked = pool[order]
    rank = np.arange(len(pool)) - np.searchsorted(ranked, ranked)
    cluster = np.empty(len(pool), dtype=np.int64)
    cluster[order] = rank % views
    return cluster


class ViewSets:
    """The clusters of all pools, from which view sets are drawn.

    If a cluster has no frames, a frame of its whole pool is drawn instead, so frames can repeat.

    Args:
        cluster: (n,) cluster of each frame in its pool, 0 to V - 1.
        pool: (n,) pool of each frame, 0 to P - 1.
        views: V.

    Attributes:
        empty: bool (P, V), clusters without frames.
    """

    def __init__(self, cluster: np.ndarray, pool: np.ndarray, views: int):
        self.views = views
        self._cluster = cluster
        self._pool = pool
        cell = pool * views + cluster
        self._members = np.argsort(cell, kind="stable")  # frames by pool, then cluster
        cells = (int(pool.max()) + 1) * views
        count = np.bincount(cell, minlength=cells).reshape(-1, views)
        start = np.concatenate([[0], np.cumsum(count)[:-1]]).reshape(-1, views)
        self.empty = count == 0
        self._start = np.where(self.empty, start[:, :1], start)
        self._count = np.where(self.empty, count.sum(axis=1, keepdims=True), count)

    def draw(
        self, anchors: np.ndarray, rng: np.random.Generator, assignment: str = "index"
    ) -> np.ndarray:
        """Return view sets int64 (A, V) of frame indices, one for each anchor.

        Args:
            anchors: (A,) frame indices.
            rng: draws the frames and their order.
            assignment: the order of the frames in a set. With `index`, column i holds a frame of
                cluster i, as in the paper. With `anchor`, as in the released code, the anchor comes
                first, and the frames of the other clusters follow in random order. With `random`,
                all frames are in random order.
        """
        pool = self._pool[anchors]
        start = self._start[pool]
        count = self._count[pool]
        drawn = (rng.random(start.shape) * count).astype(np.int64)
        sets: np.ndarray = self._members[start + drawn]
        anchor_column = self._cluster[anchors]
        rows = np.arange(len(anchors))
        sets[rows, anchor_column] = anchors
        if assignment in ("anchor", "random"):
            key = rng.random(sets.shape)
            if assignment == "anchor":
                key[rows, anchor_column] = -1
            sets = np.take_along_axis(sets, np.argsort(key, axis=1), axis=1)
        return sets


def anchor_first(sets: np.ndarray, anchors: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the columns (A, V) of each view set, the anchor's first, the others in random order.

    Args:
        sets: (A, V) frame indices.
        anchors: (A,) frame indices, each in its view set.
        rng: draws the order.
    """
    key = rng.random(sets.shape)
    anchor_column = (sets == anchors[:, None]).argmax(axis=1)
    key[np.arange(len(sets)), anchor_column] = -1
    return np.argsort(key, axis=1)


def powers_of_two(views: int) -> tuple[int, ...]:
    """Return the powers of two below `views`, from 1, and `views` itself."""
    powers = [2**power for power in range((views - 1).bit_length())]
    return (*powers, views)


def sets_of(views: Views, index: np.ndarray, rng: np.random.Generator) -> ViewSets:
    """Return the view sets of some frames, which are then numbered from 0.

    Args:
        views: cluster and pool of all frames.
        index: (k,) the frames to draw from.
        rng: draws random clusters, if no frame has a cluster.
    """
    pool = np.unique(views.pool[index], return_inverse=True)[1].ravel()
    count = len(views.viewpoints)
    if views.clustered:
        cluster = views.cluster[index].astype(np.int64)
    else:
        cluster = random_clusters(pool, count, rng)
    return ViewSets(cluster, pool, count)
