"""Clustering the frames of each pool into views, and which frames of a table get a cluster."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.cluster import KMeans

from stages.cluster import cluster
from tactile_viewgcn.tables.frames import NO_CLUSTER, TEST, Views, load_table, save_table
from tactile_viewgcn.views import clustering
from tactile_viewgcn.views.clustering import (
    cluster_pools,
    pool_ids,
    pool_scores,
    principal_components,
)
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.glove_data import recipe, table, views_of

PARAMS = recipe()
VALIDATED = "split.validation=0.25"


def same_partition(one, other):
    return np.array_equal(one[:, None] == one, other[:, None] == other)


@given(
    st.lists(st.tuples(*(st.integers(0, most) for most in (2, 1, 2, 2))), min_size=1, max_size=30)
)
@settings(max_examples=25, deadline=None)
def test_pools_are_those_of_a_loop(frames):
    columns = np.array(frames).T
    of_frames = SimpleNamespace(
        **dict(zip(("side", "label", "recording", "group"), columns, strict=True))
    )
    index = np.arange(len(frames))[::2]
    for scope, length in (("object", 2), ("recording", 4)):
        keys = [frames[i][:length] for i in index]
        numbers = {key: number for number, key in enumerate(sorted(set(keys)))}
        assert pool_ids(of_frames, index, scope).tolist() == [numbers[key] for key in keys]


def test_training_and_validation_frames_get_a_cluster_and_test_frames_none():
    frames = table(VALIDATED)
    views = views_of(frames, PARAMS)
    assert (
        views.cluster[frames.side == TEST] == NO_CLUSTER
    ).all() and views.cluster.dtype == np.int16
    for number in np.unique(views.pool[frames.side != TEST]):
        assert set(views.cluster[views.pool == number].tolist()) == set(range(4))
    np.testing.assert_array_equal(
        views.pool, pool_ids(frames, np.arange(len(frames)), PARAMS.cluster.scope)
    )
    np.testing.assert_array_equal(
        views.viewpoints, viewpoints(PARAMS.views, PARAMS.viewpoints, PARAMS.seed)
    )


def test_the_seed_decides_the_clusters(tmp_path):
    save_table(tmp_path / "frames", table(VALIDATED))
    made = []
    for seed in (3, 3, 4):
        record = SimpleNamespace(counts={})
        job = SimpleNamespace(params=recipe(f"seed={seed}"), needed=True, note=print, record=record)
        cluster(job, tmp_path, tmp_path / "frames", tmp_path / "views")
        made.append(load_table(tmp_path / "views", Views).cluster)
    assert (made[0] == made[1]).all() and not same_partition(made[0], made[2])


def test_each_pool_is_clustered_by_itself():
    """The points are six well separated blobs in random order, three in each pool."""
    rng = np.random.default_rng(1)
    blob = rng.permutation(np.repeat(np.arange(6), 10))
    points = (10 * np.eye(20)[blob] + 0.1 * rng.standard_normal((60, 20))).astype(np.float32)
    cluster = cluster_pools(points, blob // 3, 3, PARAMS.cluster, rng)
    for pool in range(2):
        assert set(cluster[blob // 3 == pool].tolist()) == {0, 1, 2}
        assert same_partition(cluster[blob // 3 == pool], blob[blob // 3 == pool])


@pytest.mark.parametrize(("method", "views"), [("none", 4), ("kmeans", 1)])
def test_random_clusters_and_a_single_one_compute_nothing(monkeypatch, method, views):
    monkeypatch.setattr(clustering, "pool_scores", None)
    monkeypatch.setattr(clustering, "kmeans", None)
    params = recipe(f"cluster.method={method}").cluster
    cluster = cluster_pools(
        np.zeros((16, 3)), np.arange(16) % 2, views, params, np.random.default_rng(0)
    )
    assert np.bincount(cluster, minlength=views).tolist() == [16 // views] * views


@pytest.mark.parametrize("shape", [(50, 6), (6, 50), (12, 12)])
def test_components_are_those_of_the_singular_values(shape):
    points = np.random.default_rng(6).random(shape)
    left, values, _ = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    np.testing.assert_allclose(
        np.abs(principal_components(points, 4)), np.abs(left * values)[:, :4], atol=1e-9
    )
    released = min(8, *shape)  # components, of the released code
    assert pool_scores(points, np.zeros(len(points), dtype=int))[0].shape == (len(points), released)


def test_k_means_is_scikit_learn_s_with_its_restarts():
    points = np.random.default_rng(0).random((80, 3))
    for restarts in (1, 10):
        expected = KMeans(8, n_init=restarts, random_state=2).fit_predict(points)
        assert same_partition(clustering.kmeans(points, 8, restarts=restarts, seed=2), expected)
