"""Principal components and k-means on extreme frames: equal, faint, flat, or far from 0.

If there are as many components as dimensions, the scores keep all distances. So scores are compared
with the points themselves.
"""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from benchmarks.stability.rows import max_rel_error, share_different
from tactile_viewgcn.views.clustering import cluster_frames, kmeans, principal_components
from tactile_viewgcn.views.sampling import ViewSets
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.glove_data import recipe, table

DIGITS = 1e-12  # of double precision
VIEWS = 8


def distances(points):
    """Return the distances (n, n) of points (n, d), without cancellation."""
    return np.sqrt(((points[:, None] - points) ** 2).sum(axis=-1))


@pytest.mark.stability("points of few dimensions")
def test_components_keep_all_distances_in_few_dimensions_and_far_from_the_origin(row):
    rng = np.random.default_rng(0)
    flat = rng.random((60, 3)) @ rng.random((3, 200))  # fewer dimensions than sensors
    for name, points in (
        ("rank 3", flat),
        ("rank 3, each ten times", np.repeat(flat, 10, axis=0)[:, :100]),
    ):
        error = max_rel_error(distances(principal_components(points, 8)), distances(points))
        row(f"distances, {name}", error, DIGITS)
    for offset in (1.0, 1e3, 1e6, 1e9):
        points = offset + rng.random((300, 4))
        error = max_rel_error(distances(principal_components(points, 4)), distances(points))
        row(f"distances, offset {offset:g}", error, DIGITS)


@pytest.mark.stability("constant points")
def test_equal_frames_are_one_cluster_and_their_view_sets_have_their_anchor(row):
    for name, points in (
        ("the same frame twice", np.full((2, 5), 0.3)),
        ("one frame 40 times", np.full((40, 5), 0.3)),
        ("no sensors", np.zeros((9, 0))),
        ("one frame", np.ones((1, 5))),
    ):
        scores = principal_components(points, 8)
        anchors = np.arange(len(points))
        row(f"scores, {name}", max_rel_error(scores, np.zeros((len(points), 1))))
        labels = kmeans(scores, VIEWS, restarts=2, seed=0)
        row(f"clusters, {name}", share_different(labels, 0 * anchors))
        sets = ViewSets(labels, 0 * anchors, VIEWS).draw(anchors, np.random.default_rng(0))
        wrong = ((sets < 0) | (sets >= len(points))).any(axis=1) | (sets[:, 0] != anchors)
        row(f"view sets with other frames, or without their anchor, {name}", wrong.mean())


@pytest.mark.stability("fewer distinct frames than clusters")
def test_three_frames_over_and_over_are_three_clusters(row):
    rng = np.random.default_rng(0)
    owner = np.arange(30) % 3
    points = rng.random((3, 6))[owner]
    for name, noise in (("equal", 0.0), ("equal to 13 digits", 1e-13)):
        scores = principal_components(points + noise * rng.random(points.shape), 6)
        labels = kmeans(scores, VIEWS, restarts=2, seed=0)
        wrong_pairs = share_different(labels[:, None] == labels, owner[:, None] == owner)
        row(f"pairs in one cluster, {name}", wrong_pairs)
        sets = ViewSets(labels, np.zeros(30, dtype=int), VIEWS).draw(np.arange(30), rng)
        row(f"empty clusters drawn from the pool, {name}", ((sets < 0) | (sets >= 30)).mean())
        row(f"clusters beyond three, {name}", labels.max() - 2)


@pytest.mark.stability("a thousand views")
def test_of_fewer_frames_than_1_000_views_each_is_a_cluster_and_every_view_is_a_frame(row):
    points = np.random.default_rng(0).random((300, 12))
    labels = kmeans(principal_components(points, 8), 1000, restarts=2, seed=0)
    row("frames that share a cluster", 300 - len(np.unique(labels)))
    view_sets = ViewSets(labels, np.zeros(300, dtype=int), 1000)
    frames = np.arange(300)
    sets = view_sets.draw(frames, np.random.default_rng(0))
    row("views that are no frame", float(((sets < 0) | (sets >= 300)).mean()))
    # each cluster has one frame, which is its view in every set
    expected = np.broadcast_to(frames, (300, 300))
    row("frames away from their cluster's view", share_different(sets[:, labels], expected))


@pytest.mark.stability("scales far from one")
def test_clusters_do_not_depend_on_the_unit(row):
    points = np.random.default_rng(0).random((300, 12))
    expected = kmeans(principal_components(points, 8), VIEWS, restarts=3, seed=1)
    for scale in (1e-30, 1e-15, 1e15, 1e30):
        labels = kmeans(principal_components(points * scale, 8), VIEWS, restarts=3, seed=1)
        row(f"clusters, {scale:g} times", share_different(labels, expected))


@pytest.mark.stability("numbers of threads")
def test_clusters_do_not_depend_on_the_number_of_threads(row):
    clusters = []
    for threads in (1, 2):
        rng = np.random.default_rng(0)
        with threadpool_limits(threads):
            views = cluster_frames(table(), viewpoints(4), recipe().cluster, rng)
        clusters.append(views.cluster)
    by_one, by_two = clusters
    row("clusters, two threads against one", share_different(by_one, by_two))
