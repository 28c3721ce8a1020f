"""Where the nodes of the view-graph sit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.views.viewpoints import viewpoints


def squared(places):
    """Return the squared distances (V, V) of places (V, 3)."""
    return ((places[:, None] - places[None]) ** 2).sum(axis=-1)


def widest(count):
    """Return the bound of Fejes Toth on the least distance of `count` points on the unit sphere.

    The bound is reached for 3, 4, 6 and 12 points.
    """
    if count == 2:
        return 2.0
    return np.sqrt(4 - np.sin(np.pi * count / (6 * (count - 2))) ** -2)


def test_the_cube_has_three_vertices_near_three_further_and_one_opposite():
    distances = np.sort(squared(viewpoints(8)), axis=1)
    np.testing.assert_array_equal(distances, np.tile([0, 4, 4, 4, 8, 8, 8, 12], (8, 1)))
    assert viewpoints(8).tolist() == sorted(viewpoints(8).tolist())


@pytest.mark.parametrize("count", [3, 12, 30])
def test_the_circle_is_thirty_degrees_up_and_its_places_are_equally_spaced(count):
    places = viewpoints(count, "circle")
    across = np.hypot(places[:, 0], places[:, 1])
    np.testing.assert_allclose(np.rad2deg(np.arctan2(places[:, 2], across)), 30)
    steps = np.linalg.norm(places - np.roll(places, 1, axis=0), axis=1)
    radius = np.sqrt(3) * np.cos(np.deg2rad(30))
    np.testing.assert_allclose(steps, 2 * radius * np.sin(np.pi / count))


@pytest.mark.parametrize("count", [2, 3, 4, 7, 50, 1000])
def test_the_sphere_s_places_are_spread_evenly(count):
    distances = squared(viewpoints(count, "sphere")) + np.diag(np.full(count, np.inf))
    nearest = np.sqrt(distances.min(axis=1) / 3)
    assert nearest.min() > 0.8 * widest(count)
    assert nearest.max() < 1.5 * widest(count)


@given(st.integers(1, 300), st.sampled_from(["auto", "random"]))
@settings(max_examples=20, deadline=None)
def test_every_place_is_as_far_out_as_a_vertex_of_the_cube_and_random_ones_follow_the_seed(
    count, kind
):
    first = viewpoints(count, kind, seed=3)
    again = viewpoints(count, kind, seed=3)
    other = viewpoints(count, kind, seed=4)
    assert first.shape == (count, 3)
    np.testing.assert_allclose(np.linalg.norm(first, axis=1), np.sqrt(3))
    np.testing.assert_array_equal(first, again)
    assert (np.abs(first - other).max(axis=1) > 1e-6).all() == (kind == "random")


def test_auto_is_the_paper_s_configuration_where_it_has_one():
    for count, kind in ((8, "cube"), (12, "circle"), (20, "sphere"), (1, "sphere"), (9, "sphere")):
        np.testing.assert_array_equal(viewpoints(count), viewpoints(count, kind))
