"""Intervals that know that frames of one group resemble each other."""

import numpy as np
import pytest

from tactile_viewgcn import statistics
from tactile_viewgcn.statistics import group_interval

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
