"""Cluster the frames of each pool: principal components, then k-means, as in the released code.

The paper says "kNN", but means k-means: it clusters frames without labels, and the released code
uses k-means.
"""

from functools import cache

import numpy as np
from threadpoolctl import ThreadpoolController

from tactile_viewgcn.params import Cluster
from tactile_viewgcn.progress import steps
from tactile_viewgcn.tables.counts import Gathered
from tactile_viewgcn.tables.frames import NO_CLUSTER, TRAIN, VALIDATION, Frames, Views
from tactile_viewgcn.views.sampling import random_clusters

COMPONENTS = 8  # principal components that k-means uses, from the released code
# smallest difference between two rows, relative to the largest score: the distances of k-means have
# no more digits
MIN_DIFFERENCE = 2.0**-20


def pool_ids(table: Frames, index: np.ndarray, scope: str) -> np.ndarray:
    """Return the pool int64 (n,) of each frame, counted from 0.

    Args:
        table: the table of frames.
        index: (n,) frames of the table.
        scope: which frames share a pool. With `object` they have the same class, in the same set of
            the split. With `recording` they have the same recording and split group too.
    """
    keys = [table.side, table.label]
    if scope == "recording":
        keys += [table.recording, table.group]
    return _numbered(np.stack(keys, axis=1)[index])


def _numbered(keys: np.ndarray) -> np.ndarray:
    """Return the rank int64 (n,) of each key (n,) or (n, k) among the distinct keys, from 0."""
    inverse: np.ndarray = np.unique(keys, axis=0, return_inverse=True)[1]
    return inverse.ravel()


def cluster_frames(
    table: Frames, viewpoints: np.ndarray, params: Cluster, rng: np.random.Generator
) -> Views:
    """Cluster the frames of each pool of the training set and the validation set into V views.

    Frames of the test set get no cluster here, because `evaluate` clusters them itself.

    Args:
        table: the table of frames.
        viewpoints: (V, 3).
        params: the section `cluster`.
        rng: draws the seeds of k-means.

    Returns:
        The cluster and the pool of each frame, with the viewpoints.
    """
    pool = pool_ids(table, np.arange(len(table)), params.scope)
    cluster = np.full(len(table), NO_CLUSTER, dtype=np.int16)
    if params.method == "kmeans":
        index = table.on(TRAIN, VALIDATION)
        cluster[index] = cluster_pools(
            table.points(index), _numbered(pool[index]), len(viewpoints), params, rng
        )
    return Views(cluster, pool, viewpoints)


def cluster_pools(
    points: np.ndarray | Gathered,
    pool: np.ndarray,
    views: int,
    params: Cluster,
    rng: np.random.Generator,
    scores: list[np.ndarray] | None = None,
) -> np.ndarray:
    """Return the cluster int64 (n,), 0 to V - 1, of each frame within its pool.

    Args:
        points: (n, d) network input at the live sensors.
        pool: (n,) pool of each frame, counted from 0.
        views: V.
        params: the section `cluster`. Its `method` chooses k-means or random clusters.
        rng: draws the seeds of k-means, or the random clusters.
        scores: the result of `pool_scores` for these points, so that several calls can share it.
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
    """Return the scores (n_p, c) of the frames of each pool p on its principal components.

    Args:
        points: (n, d).
        pool: (n,) pool of each frame, counted from 0.
    """
    numbers = steps(range(pool.max() + 1), "principal components", "pools")
    return [principal_components(points[pool == number], COMPONENTS) for number in numbers]


def principal_components(points: np.ndarray, count: int) -> np.ndarray:
    """Return the scores of points on their first principal components.

    A single thread computes the scores, so that they do not depend on the number of threads.

    Args:
        points: (n, d).
        count: number of components.

    Returns:
        float64 (n, min(count, n, d)).
    """
    from sklearn.decomposition import PCA

    # each distinct row is transformed once, so that equal rows get equal scores
    distinct, inverse = np.unique(points, axis=0, return_inverse=True)
    if len(distinct) < 2:
        return np.zeros((len(points), 1))
    points = np.array(points, dtype=np.float64)
    distinct = np.array(distinct, dtype=np.float64)
    mean = points.mean(axis=0)
    points -= mean  # before anything is squared: a large offset costs digits
    distinct -= mean
    solver = "full"
    if len(points) > points.shape[1]:
        solver = "covariance_eigh"
    with _libraries().limit(limits=1):
        pca = PCA(min(count, *points.shape), svd_solver=solver).fit(points)
        scores: np.ndarray = pca.transform(distinct)[inverse.ravel()]
    return scores


def kmeans(scores: np.ndarray, views: int, *, restarts: int, seed: int) -> np.ndarray:
    """Return the cluster int64 (n,), 0 to V - 1, of each row, by the best of several k-means runs.

    If at most V rows are distinct, each of them is a cluster, and the other clusters are empty. Two
    rows count as equal if their scores round to the same steps of `MIN_DIFFERENCE`, so that
    rounding errors hardly ever separate them.

    Args:
        scores: (n, c).
        views: V.
        restarts: number of k-means runs, the best of which is taken.
        seed: seed of k-means.
    """
    from sklearn.cluster import KMeans

    step = MIN_DIFFERENCE * np.abs(scores).max(initial=0)
    rounded = scores
    if step:
        rounded = np.rint(scores / step)
    row_of_score = _numbered(rounded)
    distinct_rows = row_of_score.max(initial=-1) + 1
    if distinct_rows <= views:
        return row_of_score
    # the problems are small: more threads would cost time, and change the order of sums
    with _libraries().limit(limits=1):
        cluster: np.ndarray = KMeans(views, n_init=restarts, random_state=seed).fit_predict(scores)
    return cluster.astype(np.int64)


@cache
def _libraries() -> ThreadpoolController:
    """Return the numerical libraries whose threads can be limited.

    The libraries are listed only once, since the listing takes half as long as a small k-means.
    """
    import sklearn.cluster  # noqa: F401  # loads the libraries

    return ThreadpoolController()
