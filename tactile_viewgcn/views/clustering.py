"""Clustering the frames of each pool into views: principal components, then k-means, as the released code does.

The paper says "kNN"; clusters of unlabelled frames and the released code mean k-means.
"""

import numpy as np
from tqdm import tqdm

from tactile_viewgcn.assignment import arranged, common_references, touched_above
from tactile_viewgcn.frames import Frames
from tactile_viewgcn.params import Cluster
from tactile_viewgcn.split import TRAIN, VALIDATION
from tactile_viewgcn.views import NO_CLUSTER, Views, random_parts

SAME = 2.0**-20  # of the largest score: rows that differ by less are one; k-means' distances have no more digits


def pool_ids(label: np.ndarray, recording: np.ndarray, side: np.ndarray, scope: str) -> np.ndarray:
    """int64 (n,): the pool of each frame. `object`: a class on one side; `recording`: a recording's part of it."""
    keys = [side, label] + ([recording] if scope == "recording" else [])
    return np.unique(np.stack(keys, axis=1), axis=0, return_inverse=True)[1].ravel()


def cluster_table(table: Frames, places: np.ndarray, how: Cluster, rng: np.random.Generator) -> Views:
    """The clusters of the training and validation frames, each at one of the viewpoints `places` (V, 3)."""
    pool, count = pool_ids(table.label, table.recording, table.side, how.scope), len(places)
    cluster, references = np.full(len(table), NO_CLUSTER, dtype=np.int16), np.zeros((count, int(table.live.sum())))
    if how.method == "kmeans":
        index = table.on(TRAIN, VALIDATION)
        own, points = np.unique(pool[index], return_inverse=True)[1].ravel(), table.inputs(index)[:, table.live]
        found = cluster_pools(points, own, count, how, rng)
        if how.assignment == "matched":
            learnt = table.side[index] == TRAIN
            pools = np.unique(own[learnt], return_inverse=True)[1].ravel()
            references = common_references(points[learnt], found[learnt], pools, count)
        touched = touched_above(table.kind, table.scale)
        cluster[index] = arranged(found, own, points, count, how.assignment, touched=touched, references=references)
    return Views(cluster, pool, places, references)


def cluster_pools(
    points: np.ndarray,
    pool: np.ndarray,
    views: int,
    how: Cluster,
    rng: np.random.Generator,
    scores: list[np.ndarray] | None = None,
) -> np.ndarray:
    """Cluster int64 (n,) of each frame within its pool, by `cluster.method`.

    Args:
        points: (n, d) live sensors of the frames' network input.
        pool: (n,) numbered from 0.
        scores: principal components of each pool where `pool_scores` has found them before.
    """
    if how.method == "none" or views == 1:
        return random_parts(pool, views, rng)
    scores = scores or pool_scores(points, pool, how.components)
    cluster = np.empty(len(pool), dtype=np.int64)
    bar = tqdm(scores, desc="k-means", unit="pool", disable=None, leave=False)
    for number, own in enumerate(bar):
        cluster[pool == number] = kmeans(own, views, restarts=how.restarts, seed=int(rng.integers(2**31)))
    return cluster


def pool_scores(points: np.ndarray, pool: np.ndarray, components: int) -> list[np.ndarray]:
    """The principal components of each pool's frames, a list over pools of (n_p, c)."""
    return [principal_components(points[pool == number], components) for number in range(pool.max() + 1)]


def principal_components(points: np.ndarray, count: int) -> np.ndarray:
    """Scores float64 (n, min(count, n, d)) of points (n, d) on their first principal components.

    One thread computes them, so that they do not depend on the number of threads.
    """
    from sklearn.decomposition import PCA
    from threadpoolctl import threadpool_limits

    points = np.asarray(points, dtype=np.float64)
    distinct, inverse = np.unique(points, axis=0, return_inverse=True)  # equal rows are to get equal scores
    if len(distinct) < 2:
        return np.zeros((len(points), 1))
    middle = points.mean(axis=0)
    points, distinct = points - middle, distinct - middle  # before anything is squared: an offset would take its digits
    solver = "covariance_eigh" if len(points) > points.shape[1] else "full"
    with threadpool_limits(1):
        found = PCA(min(count, *points.shape), svd_solver=solver).fit(points)
        return found.transform(distinct)[inverse.ravel()]


def kmeans(scores: np.ndarray, views: int, *, restarts: int, seed: int) -> np.ndarray:
    """Cluster int64 (n,), 0 to V - 1, of each row of scores (n, c): the best of `restarts` runs of k-means.

    With no more distinct rows than views each is a cluster of its own and the other clusters stay empty. Rows that
    differ by rounding alone are not distinct, see `SAME`.
    """
    from sklearn.cluster import KMeans
    from threadpoolctl import threadpool_limits

    own = _distinct(scores, views)
    if own is not None:
        return own
    with threadpool_limits(1):  # small problems: more threads cost time, and the order of sums with them
        return KMeans(views, n_init=restarts, random_state=seed).fit_predict(scores).astype(np.int64)


def _distinct(scores: np.ndarray, most: int) -> np.ndarray | None:
    """Number int64 (n,) of the distinct row that each of scores (n, c) is, where there are no more than `most`."""
    from scipy.sparse.csgraph import connected_components

    step = SAME * np.abs(scores).max(initial=0)
    cells, inverse = np.unique(np.rint(scores / step) if step else scores, axis=0, return_inverse=True)
    if len(cells) > most * 2 ** scores.shape[1]:  # rows that are one lie in cells that touch
        return None
    count, number = connected_components((np.abs(cells[:, None] - cells) <= 1).all(axis=-1))
    return number[inverse.ravel()].astype(np.int64) if count <= most else None
