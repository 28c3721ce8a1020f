"""At which viewpoint a cluster sits."""

import numpy as np
import pytest

from tactile_viewgcn.views.assignment import assigned_viewpoints, contact_threshold, reference_views

NOWHERE = np.zeros((3, 4))


def in_contact(*areas, of=4):
    """Frames (n, of) in which so many sensors are in contact."""
    return (np.arange(of) < np.array(areas)[:, None]).astype(np.float32)


def by_area(points, cluster, pool, views=3):
    return assigned_viewpoints(
        np.array(cluster), np.array(pool), points, views, "area", threshold=0.5, references=NOWHERE
    ).tolist()


def matched(points, cluster, pool, references):
    points, cluster, pool = np.array(points, dtype=np.float32), np.array(cluster), np.array(pool)
    views = len(references)
    return assigned_viewpoints(
        cluster, pool, points, views, "matched", threshold=np.nan, references=np.array(references)
    ).tolist()


@pytest.mark.parametrize(
    ("transform", "scale", "above"), [("clip", 150, 1 / 30), ("clip", 4, 1), ("log", 150, 1.791759)]
)
def test_a_sensor_is_touched_five_counts_above_rest(transform, scale, above):
    assert contact_threshold(transform, scale) == pytest.approx(above, rel=1e-6)


def test_clusters_are_numbered_by_their_mean_contact_area():
    points = in_contact(3, 1, 1, 1, 1, 1, 1, 4)  # means 2, 1 and 4; sums 4, 5 and 4
    assert by_area(points, [0, 0, 1, 1, 1, 1, 1, 2], [0] * 8) == [1, 1, 0, 0, 0, 0, 0, 2]


def test_only_sensors_above_the_threshold_count_and_how_far_does_not():
    points = np.array([[0.5, 0.5, 0.5, 0.5], [0.9, 0.6, 0, 0], [9, 0, 0, 0]])
    assert by_area(points, [2, 0, 1], [0] * 3) == [0, 2, 1]


def test_each_pool_has_an_order_of_its_own():
    points = in_contact(1, 2, 3, 3, 2, 1)
    assert by_area(points, [0, 1, 2, 0, 1, 2], [0, 0, 0, 1, 1, 1]) == [0, 1, 2, 2, 1, 0]


def test_of_equal_areas_the_one_with_the_lower_number_comes_first():
    assert by_area(in_contact(2, 2, 1), [1, 0, 2], [0] * 3) == [2, 1, 0]


@pytest.mark.parametrize(("present", "numbers"), [((0, 2), [1, 2]), ((1, 2), [1, 2]), ((0, 1), [1, 2]), ((1,), [2])])
def test_an_empty_cluster_has_no_area_and_comes_first(present, numbers):
    assert by_area(in_contact(*[2] * len(present)), present, [0] * len(present)) == numbers


def test_a_cluster_sits_where_the_reference_is_that_it_is_like():
    points = [[0, 0, 9], [0.1, 0, 7], [2, 0.5, 0], [0.1, 3, 0.2]]
    assert matched(points, [0, 0, 1, 2], [0] * 4, np.eye(3)) == [2, 2, 0, 1]


def test_the_sum_of_cosines_counts_and_not_the_best_pair():
    points = [[0.70, 0.65, 0.30], [0.6, 0.1, 0.8]]  # 0.65 + 0.6 is more than 0.7 + 0.1
    assert matched(points, [0, 1], [0, 0], np.eye(3)[:2]) == [1, 0]


def test_a_strong_grip_counts_no_more_than_a_weak_one():
    points = [[0.02, 0.01], [60, 50]]  # cosines 0.89, 0.45 and 0.77, 0.64
    assert matched(points, [1, 0], [0, 0], np.eye(2)) == [0, 1]


def test_empty_clusters_take_the_references_that_are_left():
    points = [[0, 0, 1], [0, 1, 0], [1, 0, 0]]
    assert matched(points, [0, 0, 2], [0, 1, 1], np.eye(3)) == [2, 1, 0]


def test_references_by_hand():
    points = np.array([[4, 0], [0, 2], [0, 2], [7, 0], [3, 4], [0, 0]], dtype=float)
    cluster, pool = np.array([0, 1, 1, 1, 0, 1]), np.array([0, 0, 0, 1, 1, 1])
    assigned = reference_views(points, cluster, pool, 2)
    # pool 1's cluster 0, (0.6, 0.8), joins (0, 1): their sum (0.6, 1.8) has length sqrt(3.6)
    np.testing.assert_allclose(assigned, [[1, 0], [0.6 / 3.6**0.5, 1.8 / 3.6**0.5]])


def test_references_are_aligned_until_no_assignment_changes():
    angle = np.deg2rad([0, 85, 85, -75])  # a pool's clusters lie on either side of the third axis
    across = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([np.insert(across, 2, 1, axis=1), np.insert(-across, 2, 1, axis=1)])
    cluster, pool = np.repeat([0, 1], 4), np.tile(np.arange(4), 2)
    assigned = reference_views(points, cluster, pool, 2)
    # pool 3 is nearer the first pool as it is, at 75 degrees, and nearer the mean, at 36, the other way round
    x, y = across.T @ [1, 1, 1, -1]
    np.testing.assert_allclose(assigned, np.array([[x, y, 4], [-x, -y, 4]]) / np.hypot(np.hypot(x, y), 4))
    assert matched(points, cluster, pool, assigned) == [0, 0, 0, 1, 1, 1, 1, 0]


def test_a_pool_that_lacks_a_cluster_adds_nothing_to_its_reference():
    points = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0.6, 0.8], [1, 0, 0]])
    cluster, pool = np.array([0, 1, 2, 0, 1]), np.array([0, 0, 0, 1, 1])
    assigned = reference_views(points, cluster, pool, 3)
    np.testing.assert_allclose(assigned, [[1, 0, 0], [0, 1, 0], [0, 0.6 / 3.6**0.5, 1.8 / 3.6**0.5]], atol=1e-12)


def planted(pools=7, views=5, sensors=30, seed=0):
    """Views common to all pools, whose clusters have them in another order each: points, cluster, pool, view, views."""
    rng = np.random.default_rng(seed)
    directions = rng.random((views, sensors)) ** 4
    count = rng.integers(2, 9, size=(pools, views))
    pool = np.repeat(np.arange(pools), count.sum(axis=1))
    view = np.concatenate([np.repeat(np.arange(views), each) for each in count])
    cluster = np.stack([rng.permutation(views) for _ in range(pools)])[pool, view]
    strength = rng.uniform(0.2, 3, size=(pools, 1))[pool]
    points = strength * (directions[view] + 0.05 * rng.standard_normal((len(pool), sensors)))
    order = rng.permutation(len(pool))
    return points[order], cluster[order], pool[order], view[order], directions


def test_planted_views_are_found_and_every_pool_s_clusters_aligned_with_them():
    points, cluster, pool, view, directions = planted()
    references = reference_views(points, cluster, pool, 5)
    assigned = np.array(matched(points, cluster, pool, references))
    pairs = set(zip(view.tolist(), assigned.tolist(), strict=True))
    assert len(pairs) == 5 and {number for _, number in pairs} == set(range(5))
    assert len(set(zip(view.tolist(), cluster.tolist(), strict=True))) > 5
    np.testing.assert_array_equal(assigned[pool == 0], cluster[pool == 0])
    for one, number in pairs:
        assert references[number] @ directions[one] / np.linalg.norm(directions[one]) > 0.99
    np.testing.assert_allclose(np.linalg.norm(references, axis=1), 1)


def test_a_new_pool_is_aligned_with_references_that_it_had_no_part_in():
    points, cluster, pool, view, _ = planted()
    learnt = pool < 5
    references = reference_views(points[learnt], cluster[learnt], pool[learnt], 5)
    assigned = np.array(matched(points, cluster, pool, references))
    assert len(set(zip(view.tolist(), assigned.tolist(), strict=True))) == 5


@pytest.mark.parametrize("assignment", ["area", "matched"])
def test_a_pool_s_numbers_do_not_depend_on_which_object_it_is_nor_on_other_pools(assignment):
    points, cluster, pool, _, directions = planted()

    def numbers(points, cluster, pool):
        return assigned_viewpoints(cluster, pool, points, 5, assignment, threshold=0.1, references=directions)

    assigned = numbers(points, cluster, pool)
    assert (assigned != cluster).any()
    np.testing.assert_array_equal(numbers(points, cluster, 6 - pool), assigned)
    for number in range(7):
        of_pool = pool == number
        np.testing.assert_array_equal(
            numbers(points[of_pool], cluster[of_pool], np.zeros(of_pool.sum(), dtype=int)), assigned[of_pool]
        )


@pytest.mark.parametrize("assignment", ["index", "anchor", "random"])
def test_other_assignments_leave_the_clusters_their_numbers(assignment):
    points, cluster, pool, _, directions = planted()
    assigned = assigned_viewpoints(cluster, pool, points, 5, assignment, threshold=0.1, references=directions)
    np.testing.assert_array_equal(assigned, cluster)
