"""View sets of whole recordings whose clusters are known."""

import numpy as np
import pytest

from tactile_viewgcn.params import Cluster
from tactile_viewgcn.views import recording_clusters
from tactile_viewgcn.views.recording_clusters import RecordingClusters


def clumps(sizes, seed=0):
    """Return points (T, 12) in clumps that are far from each other, and the clump (T,) of each.

    The clumps have these numbers of frames. The points are in random order.
    """
    rng = np.random.default_rng(seed)
    clump = rng.permutation(np.repeat(np.arange(len(sizes)), sizes))
    centres = 100 * rng.normal(size=(len(sizes), 12))
    return (centres[clump] + rng.normal(size=(len(clump), 12))).astype(np.float32), clump


@pytest.mark.parametrize("assignment", ["index", "anchor", "random"])
@pytest.mark.parametrize("sizes", [(9, 2, 4, 1), (5, 5, 5, 5), (40, 1, 1, 1), (1, 1, 1, 1)])
def test_each_frame_has_a_set_of_one_frame_of_each_cluster(sizes, assignment):
    points, clump = clumps(sizes)
    frames = len(points)
    sets = RecordingClusters(Cluster(assignment=assignment)).view_sets(points, 4)
    assert sets.shape == (frames, 4)
    sorted_clumps = np.sort(clump[sets], axis=1)
    np.testing.assert_array_equal(sorted_clumps, np.tile(np.arange(4), (frames, 1)))
    is_the_frame = sets == np.arange(frames)[:, None]
    assert is_the_frame.sum(axis=1).tolist() == [1] * frames
    orders = {tuple(row) for row in clump[sets].tolist()}
    assert (len(orders) == 1) == (assignment == "index")  # a cluster stays at its viewpoint


@pytest.mark.parametrize(("frames", "distinct"), [(1, 1), (3, 3), (6, 2), (5, 1)])
def test_a_recording_of_fewer_frames_or_of_equal_ones_repeats_frames(frames, distinct):
    different, _ = clumps([1] * distinct)
    points = different[np.arange(frames) % distinct]
    sets = RecordingClusters(Cluster()).view_sets(points, 4)
    assert sets.shape == (frames, 4)
    assert sets.min() >= 0
    assert sets.max() < frames
    assert all(frame in row for frame, row in enumerate(sets.tolist()))


def test_a_recording_has_one_answer_whatever_was_drawn_before():
    points, _ = clumps((9, 2, 4, 1))
    other_points, _ = clumps((3, 3, 3, 3), seed=1)
    clusters = RecordingClusters(Cluster())
    first = clusters.view_sets(points, 4)
    clusters.view_sets(other_points, 4)
    np.testing.assert_array_equal(clusters.view_sets(points, 4), first)
    np.testing.assert_array_equal(RecordingClusters(Cluster()).view_sets(points, 4), first)


def test_the_order_of_the_points_in_memory_does_not_count(monkeypatch):
    points = np.random.default_rng(0).random((60, 500)).astype(np.float32)
    all_scores = []

    def kmeans(scores, *args, **options):
        all_scores.append(scores)
        return np.arange(len(scores)) % 8

    monkeypatch.setattr(recording_clusters, "kmeans", kmeans)
    for order in "CF":
        RecordingClusters(Cluster()).view_sets(np.array(points, order=order), 8)
    by_rows, by_columns = all_scores
    np.testing.assert_array_equal(by_columns, by_rows)
