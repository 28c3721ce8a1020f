"""Paired differences by groups, and many of them at once."""

import numpy as np
import pytest

from tactile_viewgcn.evaluation.statistics import holm, sign_flip


def test_signs_of_six_groups_that_all_differ_one_way_come_up_twice_in_64():
    groups = np.repeat(np.arange(6), 3)
    p = sign_flip(np.full(18, 0.5), groups, np.random.default_rng(0))
    assert p == 2 / 64


def test_a_difference_that_one_group_makes_is_no_evidence():
    difference = np.array([9.0, 0, 0, 0, 0])
    assert sign_flip(difference, np.arange(5), np.random.default_rng(0)) == 1
    assert sign_flip(np.zeros(5), np.arange(5), np.random.default_rng(0)) == 1


def test_many_view_sets_of_a_group_are_one_observation():
    rng, difference = np.random.default_rng(0), np.tile([1.0, -0.2], 500)
    assert sign_flip(difference, np.arange(1000) % 2, rng) == 1.0  # two groups cannot be told from chance
    assert sign_flip(difference, np.arange(1000), rng) < 0.001


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.5, 0.9, 0.02]) == pytest.approx([1.0, 1.0, 0.06])
    assert holm([]) == []


def test_draws_agree_with_all_ways():
    rng, groups = np.random.default_rng(1), np.arange(13)
    difference = rng.normal(0.3, 1, 13)
    exact = sign_flip(difference, groups, rng)  # 2^13 ways
    more = sign_flip(np.append(difference, [0.0]), np.arange(14), rng)  # 2^14, so drawn; a group of 0 changes nothing
    assert more == pytest.approx(exact, abs=0.02)
