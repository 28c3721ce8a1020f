"""Intervals that resample groups, against a loop, exact forms and simulated data."""

import numpy as np
import pytest
from scipy.stats import beta

from benchmarks.stability.rows import max_rel_error
from tactile_viewgcn.intervals import group_interval, proportion_interval

DIGITS = 1e-12  # of double precision


def naive_interval(values, groups, rng):
    """Return the interval of `group_interval`, resampled one group at a time."""
    members = [values[groups == group] for group in np.unique(groups)]
    means = []
    for _ in range(4000):
        drawn = rng.integers(len(members), size=len(members))
        means.append(np.concatenate([members[index] for index in drawn]).mean())
    return np.percentile(means, [2.5, 97.5])


@pytest.mark.stability("intervals")
def test_one_group_has_no_interval(row):
    intervals = []
    for interval_of in (group_interval, proportion_interval):
        intervals.append(interval_of(np.ones(9), np.full(9, 4), np.random.default_rng(0)))
    row("one group has no interval", float(intervals != [None, None]))


def test_the_interval_is_that_of_a_loop_and_a_group_weighs_as_much_as_it_has_values():
    rng = np.random.default_rng(0)
    groups = rng.permutation(np.repeat([3, 9, 5, 0, 7, 8], [1, 7, 4, 2, 30, 12]))
    values = rng.integers(0, 11, size=56) / 10 * (groups > 5)
    interval = group_interval(values, groups, rng)
    assert interval == pytest.approx(naive_interval(values, groups, rng), abs=0.02)


@pytest.mark.stability("intervals")
@pytest.mark.parametrize("count", [2, 400])
@pytest.mark.parametrize(("name", "share"), [("right", 1.0), ("wrong", 0.0)])
def test_where_all_is_right_or_wrong_the_interval_is_clopper_and_pearsons_of_the_groups(
    row, name, share, count
):
    groups = np.repeat(np.arange(count), 3)
    low, high = proportion_interval(np.full(len(groups), share), groups, np.random.default_rng(0))
    exact = (0.0, beta.ppf(0.975, 1, count))
    if share == 1:
        exact = (beta.ppf(0.025, count, 1), 1.0)
    error = max_rel_error((low, high), exact)
    row(f"all {name}, {count} groups", error, DIGITS, f"{low:.3f} to {high:.3f}")


def test_one_wrong_view_set_does_not_narrow_the_interval_of_few_groups():
    groups = np.repeat(np.arange(4), 15)
    correct = np.ones(60)
    flawless = proportion_interval(correct, groups, np.random.default_rng(0))
    correct[7] = 0.9
    low, high = proportion_interval(correct, groups, np.random.default_rng(0))
    assert group_interval(correct, groups, np.random.default_rng(0))[0] > 0.98
    assert (low, high) == flawless and low == pytest.approx(0.025 ** (1 / 4))
    of_errors = proportion_interval(1 - correct, groups, np.random.default_rng(0))
    assert of_errors[1] == pytest.approx(1 - low)
