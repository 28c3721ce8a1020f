"""Clustering the frames of each pool into views."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from tactile_viewgcn.views import clustering
from tactile_viewgcn.views.clustering import (
    cluster_pools,
    distinct_rows,
    kmeans,
    pool_ids,
    pool_scores,
    principal_components,
)
from tests.small_tables import recipe

KMEANS = recipe().cluster


def blobs(count, each, rng, dimensions=20):
    """Points (count * each, dimensions) in well separated blobs, in random order, and the blob of each."""
    blob = rng.permutation(np.repeat(np.arange(count), each))
    centres = 10 * np.eye(dimensions)[:count]
    return (centres[blob] + 0.1 * rng.standard_normal((len(blob), dimensions))).astype(np.float32), blob


def same_partition(one, other):
    return np.array_equal(one[:, None] == one, other[:, None] == other)


@given(st.lists(st.tuples(*(st.integers(0, most) for most in (2, 1, 2, 2, 2))), min_size=1, max_size=30))
@settings(max_examples=25, deadline=None)
def test_pools_are_those_that_a_loop_finds(frames):
    columns = np.array(frames).T
    table = SimpleNamespace(**dict(zip(("side", "label", "recording", "group", "grasp"), columns, strict=True)))
    index = np.arange(len(frames))[::2]
    for scope, length in (("object", 2), ("recording", 4), ("grasp", 5)):
        keys = [frames[i][:length] for i in index]
        numbers = {key: number for number, key in enumerate(sorted(set(keys)))}
        assert pool_ids(table, index, scope).tolist() == [numbers[key] for key in keys]


def test_kmeans_keeps_the_best_of_its_restarts():
    scores = np.random.default_rng(3).random((100, 9))[:, :2]

    def spread(restarts, seed):
        cluster = kmeans(scores, 9, restarts=restarts, seed=seed)
        return sum(((scores[cluster == k] - scores[cluster == k].mean(axis=0)) ** 2).sum() for k in range(9))

    once, best = ([spread(restarts, seed) for seed in range(6)] for restarts in (1, 40))
    assert max(best) < 1.02 * min(best)
    assert max(once) > 1.05 * max(best)


def test_each_pool_is_clustered_on_its_own():
    rng = np.random.default_rng(1)
    points, blob = blobs(6, 10, rng)
    pool = blob // 3
    cluster = cluster_pools(points, pool, 3, KMEANS, rng)
    for number in range(2):
        assert set(cluster[pool == number].tolist()) == {0, 1, 2}
        assert same_partition(cluster[pool == number], blob[pool == number])


def test_the_same_seed_gives_the_same_clusters():
    points = np.random.default_rng(4).random((60, 30))
    pool = np.arange(60) % 2
    first, other = (cluster_pools(points, pool, 4, KMEANS, np.random.default_rng(seed)) for seed in (7, 8))
    again = cluster_pools(points, pool, 4, KMEANS, np.random.default_rng(7), pool_scores(points, pool))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


@pytest.mark.parametrize(("method", "views"), [("none", 4), ("kmeans", 1)])
def test_without_clusters_to_find_nothing_is_searched(monkeypatch, method, views):
    monkeypatch.setattr(clustering, "pool_scores", None)
    monkeypatch.setattr(clustering, "kmeans", None)
    params = recipe(f"cluster.method={method}").cluster
    cluster = cluster_pools(np.zeros((16, 3)), np.arange(16) % 2, views, params, np.random.default_rng(0))
    assert np.bincount(cluster, minlength=views).tolist() == [16 // views] * views


@pytest.mark.parametrize("shape", [(50, 6), (6, 50), (12, 12)])
def test_components_are_those_of_the_singular_values(shape):
    points = np.random.default_rng(6).random(shape)
    left, values, _ = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    np.testing.assert_allclose(np.abs(principal_components(points, 4)), np.abs(left * values)[:, :4], atol=1e-9)


def joined_pairwise(scores, most):
    """`distinct_rows` by comparing every pair of cells."""
    step = clustering.MIN_DIFFERENCE * np.abs(scores).max(initial=0)
    cells, inverse = np.unique(np.rint(scores / step) if step else scores, axis=0, return_inverse=True)
    near = (np.abs(cells[:, None] - cells) <= 1).all(axis=-1)
    count, number = connected_components(near)
    return number[inverse.ravel()] if count <= most and len(cells) <= most * 2 ** scores.shape[1] else None


@settings(max_examples=100, deadline=None)
@given(st.integers(1, 30), st.integers(1, 3), st.integers(1, 10), st.integers(1, 4), st.integers(0, 10_000))
def test_distinct_rows_are_those_of_a_comparison_of_every_pair(rows, columns, spacing, most, seed):
    """Rows lie on a grid of half steps, so that they fall into the same, neighbouring and distant cells."""
    rng = np.random.default_rng(seed)
    scores = 1 - rng.integers(0, 4, (rows, columns)) * spacing / 2 * clustering.MIN_DIFFERENCE
    scores[0] = 1
    number, expected = distinct_rows(scores, most), joined_pairwise(scores, most)
    assert (number is None) == (expected is None)
    if expected is not None:
        np.testing.assert_array_equal(number, expected)


@pytest.mark.parametrize("repeated", [False, True])
def test_distinct_rows_of_a_large_pool_need_memory_for_its_rows_alone(repeated):
    """6,000 frames and 64 components; an array of all pairs would take 2 GB of booleans and 18 GB of differences."""
    rows = np.random.default_rng(0).random((20 if repeated else 6000, 64))
    which = np.arange(6000) % len(rows)
    scores = rows[which] * (1 + 1e-13 * np.random.default_rng(1).random((6000, 64)))
    tracemalloc.start()
    number = distinct_rows(scores, 64)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10 * scores.nbytes
    if repeated:
        assert same_partition(number, which)
    else:
        assert number is None
