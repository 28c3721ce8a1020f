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


def same_partition(clusters, others):
    """Return whether two clusterings (n,) put the same points together."""
    return np.array_equal(clusters[:, None] == clusters, others[:, None] == others)


#: set, label, recording and group of a frame
KEYS = st.tuples(st.integers(0, 2), st.integers(0, 1), st.integers(0, 2), st.integers(0, 2))


@given(st.lists(KEYS, min_size=1, max_size=30))
@settings(max_examples=25, deadline=None)
def test_pools_are_those_of_a_loop(frames):
    side, label, recording, group = np.array(frames).T
    of_frames = SimpleNamespace(side=side, label=label, recording=recording, group=group)
    index = np.arange(len(frames))[::2]
    for scope, length in (("object", 2), ("recording", 4)):
        keys = [frames[i][:length] for i in index]
        in_order = sorted(set(keys))
        expected = [in_order.index(key) for key in keys]
        assert pool_ids(of_frames, index, scope).tolist() == expected


def test_training_and_validation_frames_get_a_cluster_and_test_frames_none():
    frames = table(VALIDATED)
    views = views_of(frames, PARAMS)
    assert views.cluster.dtype == np.int16
    assert (views.cluster[frames.side == TEST] == NO_CLUSTER).all()
    for pool in np.unique(views.pool[frames.side != TEST]):
        assert set(views.cluster[views.pool == pool].tolist()) == set(range(4))
    pools = pool_ids(frames, np.arange(len(frames)), PARAMS.cluster.scope)
    np.testing.assert_array_equal(views.pool, pools)
    places = viewpoints(PARAMS.views, PARAMS.viewpoints, PARAMS.seed)
    np.testing.assert_array_equal(views.viewpoints, places)


def test_the_seed_decides_the_clusters(tmp_path):
    save_table(tmp_path / "frames", table(VALIDATED))
    clusters = []
    for seed in (3, 3, 4):
        record = SimpleNamespace(counts={})
        job = SimpleNamespace(params=recipe(f"seed={seed}"), needed=True, note=print, record=record)
        cluster(job, tmp_path, tmp_path / "frames", tmp_path / "views")
        clusters.append(load_table(tmp_path / "views", Views).cluster)
    first, again, other = clusters
    assert (first == again).all()
    assert not same_partition(first, other)


def test_each_pool_is_clustered_by_itself():
    """The points are six well separated blobs in random order, three in each pool."""
    rng = np.random.default_rng(1)
    blob = rng.permutation(np.repeat(np.arange(6), 10))
    points = (10 * np.eye(20)[blob] + 0.1 * rng.standard_normal((60, 20))).astype(np.float32)
    cluster = cluster_pools(points, blob // 3, 3, PARAMS.cluster, rng)
    for pool in range(2):
        in_pool = blob // 3 == pool
        assert set(cluster[in_pool].tolist()) == {0, 1, 2}
        assert same_partition(cluster[in_pool], blob[in_pool])


@pytest.mark.parametrize(("method", "views"), [("none", 4), ("kmeans", 1)])
def test_random_clusters_and_a_single_one_compute_nothing(monkeypatch, method, views):
    monkeypatch.setattr(clustering, "pool_scores", None)
    monkeypatch.setattr(clustering, "kmeans", None)
    params = recipe(f"cluster.method={method}").cluster
    rng = np.random.default_rng(0)
    cluster = cluster_pools(np.zeros((16, 3)), np.arange(16) % 2, views, params, rng)
    assert np.bincount(cluster, minlength=views).tolist() == [16 // views] * views


@pytest.mark.parametrize("shape", [(50, 6), (6, 50), (12, 12)])
def test_components_are_those_of_the_singular_values(shape):
    points = np.random.default_rng(6).random(shape)
    left, values, _ = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    expected = (left * values)[:, :4]
    components = principal_components(points, 4)
    np.testing.assert_allclose(np.abs(components), np.abs(expected), atol=1e-9)
    scores = pool_scores(points, np.zeros(len(points), dtype=int))[0]
    assert scores.shape == (len(points), min(8, *shape))  # as many as in the released code


def test_k_means_is_scikit_learn_s_with_its_restarts():
    points = np.random.default_rng(0).random((80, 3))
    for restarts in (1, 10):
        expected = KMeans(8, n_init=restarts, random_state=2).fit_predict(points)
        assert same_partition(clustering.kmeans(points, 8, restarts=restarts, seed=2), expected)
