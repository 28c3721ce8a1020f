"""Principal components and k-means on data that leave them little to go by.

As many components as the points have dimensions keep all distances, so scores are held against the points themselves.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from studies.stability.case import Finding, Subject, apart, differing, finite
from tactile_viewgcn.clustering import cluster_table, kmeans, principal_components
from tactile_viewgcn.split import TEST
from tactile_viewgcn.viewpoints import viewpoints
from tactile_viewgcn.views import ViewSets

DIGITS = 1e-12  # of double precision
VIEWS = 8


def points_of_few_dimensions(_: Subject) -> Iterator[Finding]:
    """Frames in a space of three dimensions, fewer than sensors, more than sensors, each there ten times."""
    rng = np.random.default_rng(0)
    flat = rng.random((60, 3)) @ rng.random((3, 200))
    for name, points in (("rank 3", flat), ("rank 3, each ten times", np.repeat(flat, 10, axis=0)[:, :100])):
        yield Finding(
            f"distances, {name}", apart(_distances(principal_components(points, 8)), _distances(points)), DIGITS
        )
    for offset in (1.0, 1e3, 1e6, 1e9):
        points = offset + rng.random((300, 4))
        found = _distances(principal_components(points, 4))
        yield Finding(f"distances, offset {offset:g}", apart(found, _distances(points)), DIGITS)


def constant_points(_: Subject) -> Iterator[Finding]:
    """Frames that are all one, no sensors at all, and one frame."""
    for name, points in (
        ("the same frame twice", np.full((2, 5), 0.3)),
        ("one frame 40 times", np.full((40, 5), 0.3)),
        ("no sensors", np.zeros((9, 0))),
        ("one frame", np.ones((1, 5))),
    ):
        scores = principal_components(points, 8)
        yield Finding(f"scores, {name}", apart(scores, np.zeros((len(points), 1))), 0)
        labels = kmeans(scores, VIEWS, restarts=2, seed=0)
        yield Finding(f"clusters, {name}", differing(labels, np.zeros(len(points))), 0)
        pool = np.zeros(len(points), dtype=int)
        sets = ViewSets(labels, pool, VIEWS).draw(np.arange(len(points)), np.random.default_rng(0))
        lost = ((sets < 0) | (sets >= len(points))).any(axis=1) | (sets[:, 0] != np.arange(len(points)))
        yield Finding(f"view sets with other frames, or without their anchor, {name}", float(lost.mean()), 0)


def fewer_distinct_frames_than_clusters(_: Subject) -> Iterator[Finding]:
    """Three frames over and over, exactly and up to rounding: each is a cluster of its own."""
    rng = np.random.default_rng(0)
    owner = np.arange(30) % 3
    three = rng.random((3, 6))[owner]
    for name, noise in (("equal", 0.0), ("equal to 13 digits", 1e-13)):
        labels = kmeans(principal_components(three + noise * rng.random(three.shape), 6), VIEWS, restarts=2, seed=0)
        partition = labels[:, None] == labels
        yield Finding(f"pairs in one cluster, {name}", differing(partition, owner[:, None] == owner), 0)
        sets = ViewSets(labels, np.zeros(30, dtype=int), VIEWS).draw(np.arange(30), rng)
        yield Finding(f"empty clusters drawn from the pool, {name}", finite(sets) + (sets.max() >= 30), 0)
        yield Finding(f"clusters beyond three, {name}", int(labels.max()) - 2, 0)


def scales_far_from_one(_: Subject) -> Iterator[Finding]:
    """The same points 30 orders of magnitude smaller and larger."""
    points = np.random.default_rng(0).random((300, 12))
    expected = kmeans(principal_components(points, 8), VIEWS, restarts=3, seed=1)
    for scale in (1e-30, 1e-15, 1e15, 1e30):
        found = kmeans(principal_components(points * scale, 8), VIEWS, restarts=3, seed=1)
        yield Finding(f"clusters, {scale:g} times", differing(found, expected), 0)


def ties(_: Subject) -> Iterator[Finding]:
    """The corners of a cube, near to several centres: the same clusters twice, and none nearer to another's."""
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 5)).reshape(5, -1).T
    first, second = (kmeans(corners, 4, restarts=5, seed=3) for _ in range(2))
    yield Finding("clusters a second time", differing(second, first), 0)
    centres = np.stack([corners[first == number].mean(axis=0) for number in np.unique(first)])
    away = ((corners[:, None] - centres) ** 2).sum(axis=-1)
    own = np.take_along_axis(away, np.unique(first, return_inverse=True)[1][:, None], axis=1)[:, 0]
    yield Finding("squared distance beyond the nearest centre's", float((own - away.min(axis=1)).max()), DIGITS)


def numbers_of_threads(subject: Subject) -> Iterator[Finding]:
    """Clusters of three objects' training frames with one thread and with two."""
    table = subject.table
    chosen = np.unique(table.label)[:3]
    few = replace(table, side=np.where(np.isin(table.label, chosen), table.side, TEST).astype(table.side.dtype))
    how, places = replace(subject.params.cluster, method="kmeans"), viewpoints(subject.classifier.views)
    found = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            found.append(cluster_table(few, places, how, np.random.default_rng(0)).cluster)
    yield Finding("clusters, two threads against one", differing(*found), 0)


def _distances(points: np.ndarray) -> np.ndarray:
    """Distances (n, n) of points (n, d), without cancellation."""
    return np.sqrt(((points[:, None] - points) ** 2).sum(axis=-1))


CASES = (
    points_of_few_dimensions,
    constant_points,
    fewer_distinct_frames_than_clusters,
    scales_far_from_one,
    ties,
    numbers_of_threads,
)
