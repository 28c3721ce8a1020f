"""Clustering the frames of each pool into views."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.views import clustering
from tactile_viewgcn.views.clustering import (
    cluster_pools,
    distinct_rows,
    kmeans,
    pool_ids,
    pool_scores,
    principal_components,
)
from tests.glove_data import recipe

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


@pytest.mark.parametrize(("most", "found"), [(3, True), (2, False)])
def test_distinct_rows_are_equal_up_to_rounding(most, found):
    rows = np.random.default_rng(0).random((3, 8))
    which = np.arange(60) % 3
    number = distinct_rows(rows[which] * (1 + 1e-13 * np.random.default_rng(1).random((60, 8))), most)
    assert same_partition(number, which) if found else number is None
