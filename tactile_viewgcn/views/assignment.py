"""At which viewpoint a cluster sits. The paper has cluster i at viewpoint i, and k-means numbers clusters at random.

`index`, `anchor` and `random` leave the clusters their numbers, see `views.ViewSets.draw`. `area` numbers a pool's
clusters by their contact area; `matched` aligns them with reference views common to all pools, so that viewpoint i
means the same for every object. Both look at frames alone; only the pools of `cluster.scope: object` know labels.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from tactile_viewgcn.frames import transform

CONTACT_COUNTS = 5.0  # above rest, of a sensor that is touched
ROUNDS = 100


def touched_above(kind: str, scale: float) -> float:
    """The network input above which a sensor is touched, for that transform."""
    return float(transform(np.array(CONTACT_COUNTS), kind, scale))


def arranged(
    cluster: np.ndarray,
    pool: np.ndarray,
    points: np.ndarray,
    views: int,
    assignment: str,
    *,
    touched: float,
    references: np.ndarray,
) -> np.ndarray:
    """The clusters (n,) with the numbers that `cluster.assignment` gives them.

    Args:
        cluster, pool: (n,) of each frame; pools are numbered from 0.
        points: (n, d) network input at the live sensors.
        views: V.
        touched: see `touched_above`.
        references: (V, d), see `common_references`; of `matched` alone.
    """
    if assignment == "area":
        area = _means((points > touched).sum(axis=1, keepdims=True), cluster, pool, views)[..., 0]  # (P, V)
        order = np.argsort(area, axis=1, kind="stable")  # an empty cluster, without area, comes first
        return np.argsort(order, axis=1)[pool, cluster]
    if assignment == "matched":
        return _matching(_directions(points, cluster, pool, views), references)[pool, cluster]
    return cluster


def common_references(points: np.ndarray, cluster: np.ndarray, pool: np.ndarray, views: int) -> np.ndarray:
    """Reference views float64 (V, d): what the clusters of all pools have in common once they are aligned.

    They begin as the clusters of the first pool. Each pool's clusters are then assigned to them at the highest sum
    of cosines (Kuhn 1955), and they become the means of what is assigned to them, until no assignment changes.
    """
    directions = _directions(points, cluster, pool, views)  # (P, V, d)
    references, before = directions[0], None
    for _ in range(ROUNDS):
        place = _matching(directions, references)
        if before is not None and (place == before).all():
            break
        before = place
        references = _unit(np.take_along_axis(directions, np.argsort(place, axis=1)[..., None], axis=1).mean(axis=0))
    return references


def _matching(directions: np.ndarray, references: np.ndarray) -> np.ndarray:
    """The reference int64 (P, V) that each cluster (P, V, d) is assigned to."""
    return np.stack([linear_sum_assignment(own @ references.T, maximize=True)[1] for own in directions])


def _directions(points: np.ndarray, cluster: np.ndarray, pool: np.ndarray, views: int) -> np.ndarray:
    """Mean frame (P, V, d) of each cluster at unit length; zeros of an empty one, which is like nothing."""
    return _unit(_means(points, cluster, pool, views))


def _means(values: np.ndarray, cluster: np.ndarray, pool: np.ndarray, views: int) -> np.ndarray:
    """Mean (P, V, d) of the values (n, d) in each cluster, 0 where it is empty."""
    cells = (int(pool.max()) + 1) * views
    cell = pool * views + cluster
    total = np.zeros((cells, values.shape[1]))
    np.add.at(total, cell, values)
    count = np.bincount(cell, minlength=cells)
    return (total / np.maximum(count, 1)[:, None]).reshape(-1, views, values.shape[1])


def _unit(values: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(values, axis=-1, keepdims=True)
    return values / np.where(length > 0, length, 1)
