"""Clustering the frames of each pool into views: principal components, then k-means, as the released code does.

The paper says "kNN"; clusters of unlabelled frames and the released code mean k-means.
"""

from functools import cache

import numpy as np
from threadpoolctl import ThreadpoolController

from tactile_viewgcn.params import Cluster
from tactile_viewgcn.progress import steps
from tactile_viewgcn.tables.counts import Gathered
from tactile_viewgcn.tables.frames import NO_CLUSTER, TRAIN, VALIDATION, Frames, Views
from tactile_viewgcn.views.sampling import random_clusters

COMPONENTS = 8  # released: principal components that k-means uses
# of two rows, relative to the largest score: k-means' distances have no more digits
MIN_DIFFERENCE = 2.0**-20


def pool_ids(table: Frames, index: np.ndarray, scope: str) -> np.ndarray:
    """Pool int64 (n,) of each frame in `index` (n,), counted from 0.

    Args:
        scope: of a pool's frames: `object`: one class on one side; `recording`: also one recording
            and one split group.
    """
    keys = [table.side, table.label]
    if scope == "recording":
        keys += [table.recording, table.group]
    return np.unique(np.stack(keys, axis=1)[index], axis=0, return_inverse=True)[1].ravel()


def cluster_frames(
    table: Frames, viewpoints: np.ndarray, params: Cluster, rng: np.random.Generator
) -> Views:
    """Cluster the training and validation frames of each pool into V views, for `viewpoints` (V, 3).

    Frames of the test side get no cluster here: `evaluate` clusters them itself.
    """
    pool, views = pool_ids(table, np.arange(len(table)), params.scope), len(viewpoints)
    cluster = np.full(len(table), NO_CLUSTER, dtype=np.int16)
    if params.method == "kmeans":
        index = table.on(TRAIN, VALIDATION)
        number = np.unique(pool[index], return_inverse=True)[1].ravel()
        cluster[index] = cluster_pools(table.points(index), number, views, params, rng)
    return Views(cluster, pool, viewpoints)


def cluster_pools(
    points: np.ndarray | Gathered,
    pool: np.ndarray,
    views: int,
    params: Cluster,
    rng: np.random.Generator,
    scores: list[np.ndarray] | None = None,
) -> np.ndarray:
    """Cluster int64 (n,), 0 to V - 1, of each frame within its pool, by `cluster.method`.

    Args:
        points: (n, d) network input at the live sensors.
        pool: (n,) counted from 0.
        views: V.
        scores: result of `pool_scores` for these points, to be computed once for several calls.
    """
    if params.method == "none" or views == 1:
        return random_clusters(pool, views, rng)
    scores = scores or pool_scores(points, pool)
    cluster = np.empty(len(pool), dtype=np.int64)
    for number, pool_score in enumerate(steps(scores, "k-means", "pools")):
        seed = int(rng.integers(2**31))
        cluster[pool == number] = kmeans(pool_score, views, restarts=params.restarts, seed=seed)
    return cluster


def pool_scores(points: np.ndarray | Gathered, pool: np.ndarray) -> list[np.ndarray]:
    """Principal components (n_p, c) of the frames of each pool p, from points (n, d) and pools (n,)."""
    numbers = steps(range(pool.max() + 1), "principal components", "pools")
    return [principal_components(points[pool == number], COMPONENTS) for number in numbers]


def principal_components(points: np.ndarray, count: int) -> np.ndarray:
    """Scores float64 (n, min(count, n, d)) of points (n, d) on their first principal components.

    One thread computes them, so that they do not depend on the number of threads.
    """
    from sklearn.decomposition import PCA

    # equal rows get equal scores
    distinct, inverse = np.unique(points, axis=0, return_inverse=True)
    if len(distinct) < 2:
        return np.zeros((len(points), 1))
    points, distinct = (np.array(rows, dtype=np.float64) for rows in (points, distinct))
    mean = points.mean(axis=0)
    points -= mean  # before anything is squared: a large offset costs digits
    distinct -= mean
    solver = "covariance_eigh" if len(points) > points.shape[1] else "full"
    with _libraries().limit(limits=1):
        pca = PCA(min(count, *points.shape), svd_solver=solver).fit(points)
        return pca.transform(distinct)[inverse.ravel()]


def kmeans(scores: np.ndarray, views: int, *, restarts: int, seed: int) -> np.ndarray:
    """Cluster int64 (n,), 0 to V - 1, of each row of scores (n, c): the best of `restarts` runs of k-means.

    If at most V rows are distinct, each is a cluster, and the other clusters are empty. Two rows
    are equal if their scores round to the same steps of `MIN_DIFFERENCE`: rounding errors hardly
    ever count.
    """
    from sklearn.cluster import KMeans

    step = MIN_DIFFERENCE * np.abs(scores).max(initial=0)
    rows, number = np.unique(
        np.rint(scores / step) if step else scores, axis=0, return_inverse=True
    )
    if len(rows) <= views:
        return number.ravel()
    # small problems: more threads cost time, and change the order of sums
    with _libraries().limit(limits=1):
        return (
            KMeans(views, n_init=restarts, random_state=seed).fit_predict(scores).astype(np.int64)
        )


@cache
def _libraries() -> ThreadpoolController:
    """The numerical libraries whose threads can be limited, listed once: that takes half as long as a small k-means."""
    import sklearn.cluster  # noqa: F401  loads them

    return ThreadpoolController()
