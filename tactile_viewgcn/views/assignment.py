"""Assignment of clusters to viewpoints. In the paper cluster i is at viewpoint i, and k-means numbers them at random.

`index`, `anchor` and `random` keep the numbers of k-means, see `sampling.ViewSets.draw`. `area` numbers the clusters of
a pool by contact area. `matched` aligns them with reference views common to all pools, so that viewpoint i means the
same for every object. Neither uses labels, except through the pools of `cluster.scope: object`.
"""

from collections.abc import Iterator

import numpy as np
from scipy.optimize import linear_sum_assignment

from tactile_viewgcn.frames.transform import network_input
from tactile_viewgcn.readers.source import BLOCK_FRAMES
from tactile_viewgcn.tables.counts import Counts

CONTACT_COUNTS = 5.0  # above baseline, of a sensor in contact
MAX_ROUNDS = 100  # of matching


def contact_threshold(transform: str, scale: float) -> float:
    """Network input above which a sensor is in contact, for a transform."""
    return float(network_input(np.array(CONTACT_COUNTS), transform, scale))


def assigned_viewpoints(
    cluster: np.ndarray,
    pool: np.ndarray,
    points: Counts,
    views: int,
    assignment: str,
    *,
    threshold: float,
    references: np.ndarray,
) -> np.ndarray:
    """Viewpoint (n,), 0 to V - 1, of each frame's cluster, by `cluster.assignment`.

    Args:
        cluster, pool: (n,) of each frame; pools are counted from 0.
        points: (n, d) network input at the live sensors.
        views: V.
        threshold: see `contact_threshold`; used by `area`.
        references: (V, d), see `reference_views`; used by `matched`.
    """
    if assignment == "area":
        of_frame = np.concatenate([(part > threshold).sum(axis=1, keepdims=True) for _, part in _blocks(points)])
        area = _means(of_frame, cluster, pool, views)[..., 0]  # (P, V)
        order = np.argsort(area, axis=1, kind="stable")  # an empty cluster has no area and comes first
        return np.argsort(order, axis=1)[pool, cluster]
    if assignment == "matched":
        return _matching(_directions(points, cluster, pool, views), references)[pool, cluster]
    return cluster


def reference_views(points: Counts, cluster: np.ndarray, pool: np.ndarray, views: int) -> np.ndarray:
    """Reference views float64 (V, d): mean directions of the clusters of all pools after their alignment.

    They start as the clusters of the first pool. Then two steps alternate until no assignment changes: the clusters
    of each pool are assigned to the references with the highest sum of cosines (Kuhn 1955), and each reference
    becomes the mean of the clusters assigned to it.
    """
    directions = _directions(points, cluster, pool, views)  # (P, V, d)
    references, before = directions[0], None
    for _ in range(MAX_ROUNDS):
        place = _matching(directions, references)
        if before is not None and (place == before).all():
            break
        before = place
        references = _unit(np.take_along_axis(directions, np.argsort(place, axis=1)[..., None], axis=1).mean(axis=0))
    return references


def _matching(directions: np.ndarray, references: np.ndarray) -> np.ndarray:
    """Reference int64 (P, V) that each cluster (P, V, d) is assigned to."""
    return np.stack([linear_sum_assignment(views @ references.T, maximize=True)[1] for views in directions])


def _directions(points: Counts, cluster: np.ndarray, pool: np.ndarray, views: int) -> np.ndarray:
    """Mean frame (P, V, d) of each cluster at unit length; zeros for an empty cluster."""
    return _unit(_means(points, cluster, pool, views))


def _means(values: Counts, cluster: np.ndarray, pool: np.ndarray, views: int) -> np.ndarray:
    """Mean (P, V, d) of the values (n, d) in each cluster; zeros for an empty cluster."""
    cells = (int(pool.max()) + 1) * views
    cell = pool * views + cluster
    total = np.zeros((cells, values.shape[1]))
    for at, part in _blocks(values):
        np.add.at(total, cell[at], part)
    count = np.bincount(cell, minlength=cells)
    return (total / np.maximum(count, 1)[:, None]).reshape(-1, views, values.shape[1])


def _blocks(values: Counts) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Pairs of indices (k,), in order, and the values (k, d) there."""
    for at in np.array_split(np.arange(len(values)), len(values) // BLOCK_FRAMES + 1):
        yield at, values[at]


def _unit(values: np.ndarray) -> np.ndarray:
    """Vectors (..., d) scaled to unit length; zeros stay zeros."""
    length = np.linalg.norm(values, axis=-1, keepdims=True)
    return values / np.where(length > 0, length, 1)
