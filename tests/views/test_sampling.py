"""Drawing view sets: one frame from each cluster of a pool."""

from itertools import combinations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.tables.frames import Views
from tactile_viewgcn.views.sampling import ViewSets, anchor_first, random_clusters, sets_of

DRAWS = 6000


@st.composite
def clustered(draw):
    """Draw clusters and pools (n,) in any order, and V; some clusters are empty, but no pool is."""
    views = draw(st.integers(1, 6))
    pools = draw(st.integers(1, 4))
    extra = draw(st.lists(st.integers(0, pools - 1), max_size=30))
    pool = draw(st.permutations([*range(pools), *extra]))
    of_any_frame = st.integers(0, views - 1)
    cluster = draw(st.lists(of_any_frame, min_size=len(pool), max_size=len(pool)))
    return np.array(cluster), np.array(pool), views


@given(clustered(), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_each_column_is_of_its_cluster_the_anchor_in_its_own_and_other_assignments_reorder_that(
    case, seed
):
    cluster, pool, views = case
    view_sets = ViewSets(cluster, pool, views)
    anchors = np.arange(len(pool))
    sets = view_sets.draw(anchors, np.random.default_rng(seed), "index")
    assert sets.shape == (len(pool), views)
    np.testing.assert_array_equal(sets[anchors, cluster], anchors)
    for anchor, row in enumerate(sets):
        assert (pool[row] == pool[anchor]).all()
        for column, frame in enumerate(row):
            in_cluster = (pool == pool[anchor]) & (cluster == column)
            assert view_sets.empty[pool[anchor], column] == (not in_cluster.any())
            if in_cluster.any():
                assert cluster[frame] == column
    by_anchor = view_sets.draw(anchors, np.random.default_rng(seed), "anchor")
    np.testing.assert_array_equal(by_anchor[:, 0], anchors)
    at_random = view_sets.draw(anchors, np.random.default_rng(seed), "random")
    for other in (by_anchor, at_random):
        np.testing.assert_array_equal(np.sort(other, axis=1), np.sort(sets, axis=1))


def test_the_random_assignment_puts_the_anchor_in_every_column_equally_often():
    view_sets = ViewSets(np.repeat(np.arange(4), 2), np.zeros(8, dtype=int), 4)
    sets = view_sets.draw(np.full(DRAWS, 4), np.random.default_rng(0), "random")
    np.testing.assert_allclose((sets == 4).mean(axis=0), 0.25, atol=0.03)
    orders, counts = np.unique(sets // 2, axis=0, return_counts=True)
    assert len(orders) == 24
    np.testing.assert_allclose(counts / DRAWS, 1 / 24, atol=0.015)


def test_frames_of_a_cluster_are_drawn_equally_often_and_for_an_empty_one_those_of_its_pool():
    cluster = np.array([0, 1, 0, 0, 1, 3, 3, 3, 0])
    pool = np.array([0, 0, 0, 0, 0, 0, 0, 0, 1])
    sets = ViewSets(cluster, pool, 4).draw(np.full(DRAWS, 2), np.random.default_rng(0))
    for column, frames in enumerate(([2], [1, 4], range(8), [5, 6, 7])):
        expected = np.isin(np.arange(9), frames) / len(frames)
        share = np.bincount(sets[:, column], minlength=9) / DRAWS
        np.testing.assert_allclose(share, expected, atol=0.02)


def test_columns_are_drawn_independently_and_the_columns_beside_the_anchor_s_in_every_order():
    rng = np.random.default_rng(0)
    anchors = np.full(DRAWS, 4)
    view_sets = ViewSets(np.repeat(np.arange(4), 2), np.zeros(8, dtype=int), 4)
    sets = view_sets.draw(anchors, rng)
    _, counts = np.unique(sets[:, [0, 1, 3]], axis=0, return_counts=True)
    np.testing.assert_allclose(counts / DRAWS, np.full(8, 1 / 8), atol=0.02)
    orders, counts = np.unique(anchor_first(sets, anchors, rng), axis=0, return_counts=True)
    assert (orders[:, 0] == 2).all()
    assert np.sort(orders, axis=1).tolist() == [[0, 1, 2, 3]] * 6
    np.testing.assert_allclose(counts / DRAWS, 1 / 6, atol=0.02)


@given(
    st.lists(st.integers(0, 3), min_size=1, max_size=60),
    st.integers(1, 9),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=40, deadline=None)
def test_random_parts_of_a_pool_are_equally_large(pool, views, seed):
    pool = np.array(pool)
    parts = random_clusters(pool, views, np.random.default_rng(seed))
    for pool_id in np.unique(pool):
        sizes = np.bincount(parts[pool == pool_id], minlength=views)
        assert len(sizes) == views
        # if there are fewer frames than views, a view set shows all frames
        assert sizes.max() - sizes.min() <= 1


def test_view_sets_of_a_part_of_the_frames_count_them_from_0():
    cluster = np.array([9, 0, 1, 9, 1, 0], np.int16)
    pool = np.array([7, 3, 3, 7, 5, 5])
    views = Views(cluster, pool, np.zeros((2, 3)))
    rng = np.random.default_rng(0)
    sets = sets_of(views, np.array([1, 2, 4, 5]), rng).draw(np.array([0, 3]), rng)
    assert sets.tolist() == [[0, 1], [3, 2]]


def test_without_clusters_view_sets_are_all_pairs_of_a_pool():
    rng = np.random.default_rng(0)
    index = np.arange(8)
    views = Views((index % 2).astype(np.int16), index // 4, rng.random((2, 3)))
    assert views.clustered
    free = views.unclustered()
    assert not free.clustered
    np.testing.assert_array_equal(free.pool, views.pool)
    np.testing.assert_array_equal(free.viewpoints, views.viewpoints)
    pairs = set()
    for _ in range(60):
        sets = np.sort(sets_of(free, index, rng).draw(index, rng), axis=1)
        pairs.update((first, second) for first, second in sets.tolist())
    assert pairs == {*combinations(range(4), 2), *combinations(range(4, 8), 2)}
