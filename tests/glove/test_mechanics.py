"""Mechanics: forces are slopes of the energy, and a sphere on a bed has a closed form.

The closed form belongs to an elastic foundation.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.solver.scenes import hessian
from tactile_viewgcn.glove.hand import LINK_PATCHES
from tactile_viewgcn.glove.shapes import sphere
from tests.glove.scenes import LAYER, bed, gripping_hands, scene

WIDTH = 0.04  # m, of the bed
RADIUS = 0.1  # m, of a sphere
DEPTH = 0.001  # m by which the sphere sinks into the bed


def balanced(mechanics, y):
    """Return the balance of all hands and their palms at states (B, n)."""
    return mechanics.evaluate(np.arange(len(y)), np.zeros(len(y)), y, palm=True)


def pressed(count, position):
    """Return the balance of spheres at (B, 3) on a bed of count x count sensors, WIDTH wide."""
    hands = bed(count, WIDTH, hands=len(position))
    mechanics = scene([[sphere(RADIUS)]], position, hands=hands, stiffness=1e9, motion=False)
    return balanced(mechanics, np.zeros((len(position), 10)))


@pytest.mark.parametrize("motion", [False, True])
def test_the_residual_is_the_slope_of_the_energy(motion):
    mechanics, y = gripping_hands(motion=motion)
    balance = balanced(mechanics, y)
    on_palm = balance.contacts.patch >= LINK_PATCHES
    for row in (0, 1, 4):
        assert {False, True} == set(on_palm[balance.contacts.row == row])  # fingers and palm
    step = 1e-7
    for unknown in range(mechanics.size):
        ahead = y.copy()
        ahead[:, unknown] += step
        behind = y.copy()
        behind[:, unknown] -= step
        difference = balanced(mechanics, ahead).energy - balanced(mechanics, behind).energy
        slope = difference / (2 * step)
        np.testing.assert_allclose(balance.residual[:, unknown], slope, rtol=2e-5, atol=2e-6)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), motion=st.booleans())
def test_solving_by_blocks_equals_solving_the_whole(seed, motion):
    mechanics, y = gripping_hands(motion=motion, seed=seed)
    balance = balanced(mechanics, y)
    rng = np.random.default_rng(seed)
    matrix = mechanics.shifted_hessian(balance, scaled_step=rng.uniform(0.01, 1, len(y)))
    whole = hessian(mechanics, balance) + matrix.shift[:, :, None] * np.eye(mechanics.size)
    for residual in rng.normal(size=(2, *y.shape)):
        expected = np.linalg.solve(whole, residual[..., None])[..., 0]
        np.testing.assert_allclose(matrix.solve(residual), expected, rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize("motion", [False, True])
def test_the_change_of_the_forces_is_that_of_a_small_step(motion):
    mechanics, y = gripping_hands(motion=motion)
    balance = balanced(mechanics, y)
    dy = 1e-7 * np.random.default_rng(0).normal(size=y.shape)
    after = balanced(mechanics, y + dy)
    np.testing.assert_array_equal(after.contacts.sensor, balance.contacts.sensor)
    change = mechanics.force_change(balance, np.arange(len(y)), dy)
    tolerance = 1e-3 * np.abs(change).max()
    np.testing.assert_allclose(change, after.force - balance.force, atol=tolerance)


def test_finer_beds_come_ever_closer_to_the_closed_form():
    """At distance s from the centre the exact depth is R - s, for R - d <= s <= R.

    So the force is F_z = pi k (R - d) d^2.
    """
    stiff = 1 / (1 / LAYER.stiffness + 1 / 1e9)
    height = RADIUS - DEPTH
    load = np.pi * stiff * height * DEPTH**2
    # sum of the sizes of the forces, whatever their directions
    total = np.pi * stiff * (RADIUS * DEPTH**2 - 2 / 3 * DEPTH**3)
    edge = np.sqrt(2 * RADIUS * DEPTH - DEPTH**2)
    errors = []
    for count in (8, 16, 32, 64):
        pitch = WIDTH / count
        aside = np.random.default_rng(0).uniform(-0.5, 0.5, (16, 2)) * pitch
        balance = pressed(count, np.c_[aside, np.full(16, height)])
        row = balance.contacts.row
        away = np.linalg.norm(balance.contacts.point[:, :2] - aside[row], axis=1)
        furthest = np.array([away[row == sphere_row].max() for sphere_row in range(16)])
        assert (np.abs(furthest - edge) < pitch).all()
        upward = np.bincount(row, -balance.force * balance.contacts.normal[:, 2])
        # the radius of a disc with the area of the pressed sensors
        disc = np.sqrt(np.bincount(row) / np.pi) * pitch
        shares = np.stack([upward / load, np.bincount(row, balance.force) / total, disc / edge])
        errors.append(np.sqrt(((shares - 1) ** 2).mean(axis=1)))
    assert (np.array(errors[0]) < 0.05).all()
    assert (np.array(errors[-1]) < 1e-3).all()
    assert (np.diff(errors, axis=0) < 0).all()
