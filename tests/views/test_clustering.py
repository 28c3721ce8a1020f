"""Clustering the frames of each pool into views."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

from tactile_viewgcn import clustering
from tactile_viewgcn.clustering import cluster_pools, kmeans, pool_ids, pool_scores, principal_components
from tactile_viewgcn.split import TEST, TRAIN, VALIDATION
from tactile_viewgcn.views import NO_CLUSTER
from tests.tables import recipe, table, views_of

KMEANS = recipe().cluster


def blobs(count, each, rng, dimensions=20):
    """Points (count * each, dimensions) in well separated blobs, in random order, and the blob of each."""
    blob = rng.permutation(np.repeat(np.arange(count), each))
    centres = 10 * np.eye(dimensions)[:count]
    return (centres[blob] + 0.1 * rng.standard_normal((len(blob), dimensions))).astype(np.float32), blob


def same_partition(one, other):
    return np.array_equal(one[:, None] == one, other[:, None] == other)


def test_pools_of_objects_are_a_class_on_one_side():
    label, side = np.array([1, 0, 1, 1, 0]), np.array([0, 0, 2, 0, 0])
    pool = pool_ids(label, np.arange(5), side, "object")
    assert pool.tolist() == [1, 0, 2, 1, 0]


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 3), st.integers(0, 2)), min_size=1, max_size=30))
@settings(max_examples=25, deadline=None)
def test_pools_are_those_that_a_loop_finds(frames):
    label, recording, side = np.array(frames).T
    for scope, keys in (
        ("object", [(s, k) for k, _, s in frames]),
        ("recording", [(s, k, r) for k, r, s in frames]),
    ):
        numbers = {key: number for number, key in enumerate(sorted(set(keys)))}
        assert pool_ids(label, recording, side, scope).tolist() == [numbers[key] for key in keys]


def test_kmeans_recovers_known_blobs():
    points, blob = blobs(5, 12, np.random.default_rng(0))
    found = kmeans(points, 5, restarts=10, seed=0)
    assert set(found.tolist()) == set(range(5))
    assert same_partition(found, blob)


def test_each_pool_is_clustered_on_its_own():
    rng = np.random.default_rng(1)
    points, blob = blobs(6, 10, rng)
    pool = blob // 3
    found = cluster_pools(points, pool, 3, KMEANS, rng)
    for number in range(2):
        assert set(found[pool == number].tolist()) == {0, 1, 2}
        assert same_partition(found[pool == number], blob[pool == number])


def test_a_recording_s_pool_sees_its_own_frames_alone():
    rng = np.random.default_rng(2)
    points, blob = blobs(4, 10, rng)
    recording, nothing = blob // 2, np.zeros_like(blob)
    points[:, -1] = 100 * recording
    per_object = cluster_pools(points, pool_ids(nothing, recording, nothing, "object"), 2, KMEANS, rng)
    per_recording = cluster_pools(points, pool_ids(nothing, recording, nothing, "recording"), 2, KMEANS, rng)
    assert same_partition(per_object, recording)
    for number in range(2):
        assert same_partition(per_recording[recording == number], blob[recording == number])


def test_with_fewer_frames_than_views_each_is_a_cluster_of_its_own():
    points = np.random.default_rng(3).random((5, 40), dtype=np.float32)
    found = cluster_pools(points, np.zeros(5, dtype=int), 8, KMEANS, np.random.default_rng(0))
    assert len(set(found.tolist())) == 5
    assert found.max() < 8


def test_a_single_frame_is_a_cluster():
    found = cluster_pools(np.ones((1, 40), np.float32), np.zeros(1, dtype=int), 8, KMEANS, np.random.default_rng(0))
    assert found.tolist() == [0]


@pytest.mark.parametrize("frame", [np.zeros(100, np.float32), np.random.default_rng(0).random(100, dtype=np.float32)])
def test_identical_frames_are_one_cluster(frame):
    found = cluster_pools(np.tile(frame, (20, 1)), np.zeros(20, dtype=int), 8, KMEANS, np.random.default_rng(0))
    assert found.tolist() == [0] * 20


def test_three_frames_over_and_over_are_three_clusters():
    which = np.arange(20) % 3
    points = np.random.default_rng(0).random((3, 100), dtype=np.float32)[which]
    found = cluster_pools(points, np.zeros(20, dtype=int), 8, KMEANS, np.random.default_rng(0))
    assert same_partition(found, which)


def test_the_same_seed_gives_the_same_clusters():
    points = np.random.default_rng(4).random((60, 30))
    pool = np.arange(60) % 2
    first, again, other = (cluster_pools(points, pool, 4, KMEANS, np.random.default_rng(s)) for s in (7, 7, 8))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_components_found_before_change_nothing():
    points, pool = np.random.default_rng(5).random((40, 30)), np.arange(40) % 2
    scores = pool_scores(points, pool, KMEANS.components)
    assert [own.shape for own in scores] == [(20, 8), (20, 8)]
    given_them = cluster_pools(points, pool, 4, KMEANS, np.random.default_rng(0), scores)
    np.testing.assert_array_equal(given_them, cluster_pools(points, pool, 4, KMEANS, np.random.default_rng(0)))


@pytest.mark.parametrize(("method", "views"), [("none", 4), ("kmeans", 1)])
def test_without_clusters_to_find_nothing_is_searched(monkeypatch, method, views):
    monkeypatch.setattr(clustering, "pool_scores", None)
    monkeypatch.setattr(clustering, "kmeans", None)
    how = recipe(f"cluster.method={method}").cluster
    found = cluster_pools(np.zeros((16, 3)), np.arange(16) % 2, views, how, np.random.default_rng(0))
    assert np.bincount(found, minlength=views).tolist() == [16 // views] * views


@pytest.mark.parametrize("shape", [(50, 6), (6, 50), (12, 12)])
def test_components_are_those_of_the_singular_values(shape):
    points = np.random.default_rng(6).random(shape)
    left, values, _ = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    np.testing.assert_allclose(np.abs(principal_components(points, 4)), np.abs(left * values)[:, :4], atol=1e-9)


def test_points_on_a_line_lie_along_the_first_component():
    along = np.array([-3.0, -1, 0, 4])
    scores = principal_components(along[:, None] * [0.6, 0, 0.8] + 5, 2)
    np.testing.assert_allclose(np.abs(scores[:, 0]), np.abs(along), atol=1e-12)
    np.testing.assert_allclose(scores[:, 1], 0, atol=1e-12)


@given(st.integers(0, 12), st.integers(1, 12), st.integers(1, 8))
@settings(max_examples=25, deadline=None)
def test_there_are_never_more_components_than_frames_or_sensors(frames, sensors, count):
    points = np.random.default_rng(0).random((frames, sensors))
    expected = min(count, frames, sensors) if frames > 1 else 1
    assert principal_components(points, count).shape == (frames, expected)


VALIDATED = "split.validation=0.25"


def clusters_of(views, frames):
    """For every pool that was clustered, its frames and their clusters."""
    for number in np.unique(views.pool[frames.side != TEST]):
        own = np.flatnonzero(views.pool == number)
        yield own, views.cluster[own]


@pytest.mark.parametrize("assignment", ["area", "matched"])
def test_arranging_the_clusters_of_a_table_renumbers_them_and_nothing_else(assignment):
    frames = table(VALIDATED)
    plain, found = (views_of(frames, recipe(f"cluster.assignment={kind}")) for kind in ("index", assignment))
    np.testing.assert_array_equal(found.pool, plain.pool)
    assert (found.cluster[frames.side == TEST] == NO_CLUSTER).all()
    assert found.cluster.dtype == plain.cluster.dtype
    assert (found.cluster != plain.cluster).any()
    for own, cluster in clusters_of(found, frames):
        assert same_partition(cluster, plain.cluster[own])
        assert set(cluster.tolist()) <= set(range(4))


def test_clusters_arranged_by_area_touch_more_and_more_sensors():
    frames, found = table(VALIDATED), views_of(table(VALIDATED), recipe("cluster.assignment=area"))
    touched = ((frames.inputs(np.arange(len(frames))) > 5 / 150) & frames.live).sum(axis=(1, 2))
    for own, cluster in clusters_of(found, frames):
        areas = [touched[own][cluster == number].mean() for number in np.unique(cluster)]
        assert areas == sorted(areas)
    assert found.references.shape == (4, frames.live.sum()) and not found.references.any()


def unit(values):
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


def test_matched_clusters_of_every_pool_stand_as_near_the_references_as_any_order_could():
    frames, found = table(VALIDATED), views_of(table(VALIDATED), recipe("cluster.assignment=matched"))
    assert found.references.shape == (4, frames.live.sum())
    np.testing.assert_allclose(np.linalg.norm(found.references, axis=1), 1)
    points, sides, means = frames.inputs(np.arange(len(frames)))[:, frames.live].astype(float), set(), []
    for own, cluster in clusters_of(found, frames):
        mean = unit(np.stack([points[own][cluster == number].mean(axis=0) for number in range(4)]))
        cosines = mean @ found.references.T
        best = max(sum(cosines[np.arange(4), order]) for order in permutations(range(4)))
        assert np.trace(cosines) == pytest.approx(best)
        sides |= set(frames.side[own].tolist())
        means += [mean] if (frames.side[own] == TRAIN).all() else []
    assert sides == {TRAIN, VALIDATION}
    np.testing.assert_allclose(found.references, unit(np.mean(means, axis=0)))


def test_references_come_from_the_training_side_alone():
    frames, how = table(VALIDATED), recipe("cluster.assignment=matched")
    learnt = frames.side == TRAIN
    counts, label = frames.counts.copy(), frames.label.copy()
    counts[~learnt] = np.random.default_rng(0).permutation(counts[~learnt])
    label[frames.side == TEST] = 0
    found, other = (views_of(given, how) for given in (frames, replace(frames, counts=counts, label=label)))
    assert found.references.any()
    np.testing.assert_array_equal(other.references, found.references)
    np.testing.assert_array_equal(other.cluster[learnt], found.cluster[learnt])


@pytest.mark.parametrize("changes", [(), ("cluster.assignment=anchor",), ("cluster.method=none",)])
def test_without_matching_there_are_no_references(changes):
    found = views_of(table(), recipe(*changes))
    assert found.references.shape == (4, table().live.sum()) and not found.references.any()


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e6, 1e9])
def test_components_keep_all_distances_however_far_the_points_are(offset):
    points = offset + np.random.default_rng(0).random((40, 3))
    scores = principal_components(points, 3)
    apart = [np.linalg.norm(x[:, None] - x, axis=-1) for x in (points, scores)]
    np.testing.assert_allclose(apart[1], apart[0], atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 8), st.integers(0, 10_000), st.sampled_from([1e-30, 1.0, 1e30]))
def test_frames_that_differ_by_rounding_are_one(distinct, seed, scale):
    rng = np.random.default_rng(seed)
    owner = rng.integers(0, distinct, 25)
    scores = scale * (rng.random((distinct, 4)) + np.arange(distinct)[:, None])[owner]
    labels = kmeans(scores * (1 + 1e-13 * rng.random(scores.shape)), 8, restarts=1, seed=0)
    np.testing.assert_array_equal(labels[:, None] == labels, owner[:, None] == owner)


def test_frames_that_differ_by_rounding_are_one_on_the_edge_of_a_step_too():
    scores = np.array([[1.0, (1000.5 + sign * 1e-7) * 2.0**-20] for sign in (-1, 1) * 5])
    assert kmeans(scores, 8, restarts=1, seed=0).tolist() == [0] * 10
    apart = np.array([[1.0, 0.0], [1.0, 3 * 2.0**-20]])
    assert kmeans(np.repeat(apart, 3, axis=0), 8, restarts=1, seed=0).tolist() == [0, 0, 0, 1, 1, 1]


@pytest.mark.parametrize("shape", [(60, 20), (20, 60)])
def test_components_do_not_depend_on_the_number_of_threads(shape):
    points = np.random.default_rng(0).random(shape)
    found = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            found.append(principal_components(points, 8))
    np.testing.assert_array_equal(*found)
