"""p values of paired differences by groups, against all ways of flipping signs."""

from itertools import product

import numpy as np
import pytest

from studies.p_values import holm, sign_flip


def all_ways(sums):
    """p of whole numbers, by all ways of turning their signs."""
    ways = [abs(np.dot(signs, sums)) >= abs(sum(sums)) for signs in product((-1, 1), repeat=len(sums))]
    return np.mean(ways)


@pytest.mark.parametrize(
    "sums", [[5] * 6, [9, 0, 0, 0, 0], [2, 3, 1, -2, -2, -2], [7, -3, 4, 1, 2, 6, 5], [1, 2], [4], [0, 0]]
)
def test_p_is_that_of_all_ways_and_sums_that_rounding_tells_apart_are_equal(sums):
    groups, difference = np.repeat(np.arange(len(sums)), 2), np.repeat(np.array(sums) / 10, 2)
    assert sign_flip(difference, groups, np.random.default_rng(0)) == pytest.approx(all_ways(sums))
    sizes = np.arange(len(sums)) + 1  # a group counts by the sum of its view sets, not by their mean
    parts = np.repeat(np.array(sums) / sizes, sizes), np.repeat(np.arange(len(sums)), sizes)
    assert sign_flip(*parts, np.random.default_rng(0)) == pytest.approx(all_ways(sums))


def test_draws_agree_with_all_ways():
    rng, difference = np.random.default_rng(1), np.random.default_rng(2).normal(0.3, 1, 13)
    exact = sign_flip(difference, np.arange(13), rng)  # 2^13 ways
    drawn = sign_flip(np.append(difference, 0.0), np.arange(14), rng)  # 2^14; a group of 0 changes nothing
    assert drawn == pytest.approx(exact, abs=0.02) and drawn != exact


def test_many_view_sets_of_a_group_are_one_observation_and_draws_never_give_0():
    difference = np.tile([1.0, -0.2], 500)
    assert sign_flip(difference, np.arange(1000) % 2, np.random.default_rng(0)) == 1  # two groups show nothing
    assert 1e-4 < sign_flip(difference, np.arange(1000), np.random.default_rng(0)) < 3e-4  # (0 + 1) of 10,000 + 1


def test_p_does_not_depend_on_the_unit_and_repeats_with_the_seed():
    difference, groups = np.random.default_rng(3).normal(0.3, 1, 40), np.arange(40)
    ps = [sign_flip(scale * difference, groups, np.random.default_rng(4)) for scale in (1, 1, 1e-12, 1e12)]
    assert ps == [ps[0]] * 4 and 0.001 < ps[0] < 0.999
    assert sign_flip(np.ones(40), groups, np.random.default_rng(4)) == pytest.approx(2 / 10_001)


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.6, 0.9, 0.02]) == pytest.approx([1.0, 1.0, 0.06])
    assert holm([]) == []
