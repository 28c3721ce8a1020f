"""Intervals that know that frames of one group resemble each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest

from tactile_viewgcn import statistics
from tactile_viewgcn.statistics import calibration_error, group_interval, middle_and_tail, share_interval

GROUPS, EACH = 20, 6


def simulated(rng):
    """Right or wrong of view sets whose group decides how easy they are; 0.7 of them are right on average."""
    ease = np.repeat(rng.beta(1.4, 0.6, size=GROUPS), EACH)
    return (rng.random(GROUPS * EACH) < ease).astype(float), np.repeat(np.arange(GROUPS), EACH)


def naive_interval(correct, groups, rng, resamples):
    """The same resampling, one view set at a time."""
    members = [[c for c, g in zip(correct, groups, strict=True) if g == name] for name in sorted(set(groups.tolist()))]
    means = []
    for _ in range(resamples):
        drawn = [members[i] for i in rng.integers(len(members), size=len(members))]
        means.append(np.mean([own[int(rng.random() * len(own))] for own in drawn for _ in own]))
    return tuple(np.percentile(means, [2.5, 97.5]))


def frame_interval(correct, rng, resamples):
    """What resampling view sets gives, as if each stood for itself."""
    return np.percentile(rng.choice(correct, (resamples, len(correct))).mean(axis=1), [2.5, 97.5])


def test_one_group_says_nothing_of_how_groups_differ():
    assert group_interval(np.ones(9), np.full(9, 4), np.random.default_rng(0)) is None


def test_the_interval_is_that_of_a_loop(monkeypatch):
    monkeypatch.setattr(statistics, "RESAMPLES", 60)
    rng = np.random.default_rng(0)
    groups = rng.permutation(np.repeat([3, 9, 5, 0], [1, 7, 4, 2]))
    correct = rng.integers(0, 11, size=14) / 10
    expected = naive_interval(correct, groups, np.random.default_rng(5), 60)
    assert group_interval(correct, groups, np.random.default_rng(5)) == pytest.approx(expected, abs=1e-12)


def test_the_truth_is_inside_about_as_often_as_it_says(monkeypatch):
    monkeypatch.setattr(statistics, "RESAMPLES", 250)
    rng, inside, naively_inside = np.random.default_rng(0), 0, 0
    for _ in range(120):
        correct, groups = simulated(rng)
        low, high = group_interval(correct, groups, rng)
        inside += low <= 0.7 <= high
        low, high = frame_interval(correct, rng, 250)
        naively_inside += low <= 0.7 <= high
    assert 0.9 <= inside / 120 < 1
    assert naively_inside / 120 < 0.85


def test_groups_that_resemble_themselves_widen_the_interval():
    rng = np.random.default_rng(1)
    groups = np.repeat(np.arange(10), 30)
    correct = (groups % 2).astype(float)
    low, high = group_interval(correct, groups, rng)
    naive_low, naive_high = frame_interval(correct, rng, 2000)
    assert high - low > 4 * (naive_high - naive_low)


def test_view_sets_all_alike_have_an_interval_of_no_width():
    assert group_interval(np.full(12, 0.25), np.arange(12) % 3, np.random.default_rng(0)) == (0.25, 0.25)


def test_the_same_generator_gives_the_same_interval():
    correct, groups = simulated(np.random.default_rng(2))
    first, again = (group_interval(correct, groups, np.random.default_rng(3)) for _ in range(2))
    assert first == again
    low, high = first
    assert low < correct.mean() < high


@pytest.mark.parametrize("count", [2, 5, 27, 400])
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_where_all_is_right_or_wrong_the_interval_is_the_exact_one_of_the_groups(share, count):
    groups = np.repeat(np.arange(count), 3)
    low, high = share_interval(np.full(len(groups), share), groups, np.random.default_rng(0))
    exact = binomtest(int(share * count), count).proportion_ci(0.95, "exact")
    assert (low, high) == pytest.approx((exact.low, exact.high), abs=1e-9)


def test_any_other_share_has_the_resampled_interval():
    correct, groups = simulated(np.random.default_rng(3))
    found, expected = (f(correct, groups, np.random.default_rng(4)) for f in (share_interval, group_interval))
    assert found == expected
    assert share_interval(np.full(9, 0.5), np.arange(9), np.random.default_rng(0)) == (0.5, 0.5)
    assert share_interval(np.ones(4), np.zeros(4), np.random.default_rng(0)) is None


def test_the_calibration_error_by_hand():
    certainty = np.array([0.95, 0.95, 0.05, 0.5])
    right = np.array([True, False, False, True])
    assert calibration_error(certainty, right) == pytest.approx((0.9 + 0.05 + 0.5) / 4)
    assert calibration_error(np.ones(3), np.ones(3, dtype=bool)) == 0
    assert calibration_error(np.zeros(3), np.ones(3, dtype=bool)) == 1


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0, 1), min_size=1, max_size=60), st.integers(0, 1000))
def test_the_calibration_error_is_that_of_a_loop_over_the_bins(certainty, seed):
    certainty, total = np.array(certainty), 0.0
    right = np.random.default_rng(seed).random(len(certainty)) < certainty
    bins = np.minimum(np.floor(certainty * 15), 14)
    for number in range(15):
        own = bins == number
        if own.any():
            total += own.mean() * abs(certainty[own].mean() - right[own].mean())
    assert calibration_error(certainty, right) == pytest.approx(total, abs=1e-12)


def test_the_middle_and_the_tail_of_few_values():
    assert middle_and_tail(np.array([3.0])) == {"median": 3.0, "p95": 3.0}
    assert middle_and_tail(np.array([1.0, 2.0])) == pytest.approx({"median": 1.5, "p95": 1.95})
