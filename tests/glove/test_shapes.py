"""Signed distances of the solids, and the directions in which they grow."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tactile_viewgcn.glove.shapes import Solids, box, capsule, cylinder, sphere, torus, tube

HAND_WORKED = [  # shape, point, distance
    (sphere(2), (0, 3, -4), 3),
    (box(2, 4, 6), (-4, 6, 0), 5),
    (box(2, 4, 6), (0.25, 1.5, 0), -0.5),
    (box(2, 4, 6, 0.5), (1, 2, 3), 0.5 * np.sqrt(3) - 0.5),
    (cylinder(1, 4), (0, 4, 6), 5),
    (cylinder(1, 4), (0.5, 0, -1.75), -0.25),
    (cylinder(1, 4, 0.5), (3.5, 0, 5.5), 4.5),
    (capsule(1, 6), (3, 0, -6), 4),
    (torus(3, 1), (3, 0, 0), -1),
    (torus(3, 1), (0, -7, 3), 4),
    (tube(2, 3, 4), (-2.5, 0, 0), -0.5),
    (tube(2, 3, 4), (0, 6, -6), 5),
    (sphere(2, cut=(0, 0, 1, 1)), (0, 0, 1.5), 0.5),
    (sphere(2, cut=(0, 0, 1, 1)), (0, 0, 0), -1),
]
PARTS = (
    sphere(0.03),
    box(0.02, 0.05, 0.09),
    box(0.02, 0.05, 0.09, 0.006),
    cylinder(0.02, 0.05, 0.004),
    cylinder(0.04, 0.02),
    capsule(0.01, 0.06),
    torus(0.03, 0.008),
    tube(0.02, 0.03, 0.04, 0.003),
    tube(0.0, 0.02, 0.05),
    box(0.03, 0.04, 0.05, cut=(0.6, 0.0, 0.8, 0.01)),
    torus(0.03, 0.01, cut=(-1.0, 0.0, 0.0, 0.01)),
)
position = st.tuples(*[st.floats(-0.08, 0.08)] * 3).map(np.array)


def distance(part, point):
    """Return the signed distances (n,) of one primitive at points (n, 3) or (3,)."""
    points = np.atleast_2d(np.asarray(point, dtype=float))
    first = np.zeros(len(points), dtype=int)
    return Solids([[part]]).distance(first, first, points)


def gradient(part, point):
    """Return the gradient (3,) of the distance of one primitive at a point (3,)."""
    first = np.zeros(1, dtype=int)
    return Solids([[part]]).gradient(first, first, np.array([point], dtype=float))[0]


@pytest.mark.parametrize(("part", "at", "expected"), HAND_WORKED)
def test_distances_by_hand(part, at, expected):
    assert distance(part, at)[0] == pytest.approx(expected, abs=1e-12)


@settings(max_examples=300, deadline=None)
@given(part=st.sampled_from(PARTS), point=position)
def test_the_gradient_is_a_unit_vector_and_the_slope_of_the_distance(part, point):
    step = 1e-6
    ahead = distance(part, point + step * np.eye(3))
    behind = distance(part, point - step * np.eye(3))
    here = distance(part, point)
    # no edge, axis or middle surface in between
    assume(np.abs(ahead + behind - 2 * here).max() < 1e-3 * step)
    slope = gradient(part, point)
    np.testing.assert_allclose(slope, (ahead - behind) / (2 * step), atol=1e-3)
    assert np.linalg.norm(slope) == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("at", [(0, 0, 0), (0, 0, 0.07), (0.03, 0, 0), (0, -0.03, 0)])
@pytest.mark.parametrize("part", PARTS)
def test_on_axes_and_kinks_the_gradient_is_still_a_unit_vector(part, at):
    assert np.linalg.norm(gradient(part, at)) == pytest.approx(1, abs=1e-12)
