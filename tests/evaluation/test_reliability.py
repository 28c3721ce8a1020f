"""Probabilities compared with errors, on answers whose agreement is known."""

import numpy as np
import pytest

from tactile_viewgcn.evaluation.reliability import ANSWERS, BINS, reliability
from tactile_viewgcn.evaluation.trials import Trials


def measured(probability, correct, groups=None):
    """Return the reliability of answers with these probabilities, each a group by default."""
    probability = np.array(probability, dtype=np.float32)
    labels = np.zeros(len(probability), dtype=int)
    best = np.where(correct, 0, 1)[None, :, None]
    if groups is None:
        groups = np.arange(len(probability))
    probabilities = np.column_stack([probability, 1 - probability])
    trials = Trials(best, labels, groups, labels, 8, probabilities=probabilities)
    return reliability(trials, np.random.default_rng(0))


def test_the_numbers_are_those_computed_by_hand():
    # 5 of the 10 answers with 0.9 are right, and 7 of the 10 with 0.6, in mixed order
    probability = [0.9, 0.6] * 10
    correct = [1, 1] * 5 + [0, 1] * 2 + [0, 0] * 3
    result = measured(probability, correct)
    assert (result.expected, result.error) == pytest.approx((0.25, 8 / 20))
    assert result.low < 0.15 < result.high
    low, high = result.bins  # from low to high probability
    assert (low.answers, low.expected, low.error) == pytest.approx((10, 0.4, 0.3))
    assert (high.answers, high.expected, high.error) == pytest.approx((10, 0.1, 0.5))
    assert low.low < 0.3 < low.high


def test_answers_without_probabilities_have_no_reliability():
    labels = np.zeros(4, dtype=int)
    trials = Trials(labels[None, :, None], labels, labels, labels, 8)
    assert reliability(trials, np.random.default_rng(0)) is None


@pytest.mark.parametrize(("shift", "sign"), [(0.0, 0), (0.15, 1), (-0.15, -1)])
def test_the_interval_tells_exact_probabilities_from_others(shift, sign):
    rng = np.random.default_rng(1)
    chance = rng.uniform(0.65, 0.8, 2000)
    result = measured(chance + shift, rng.random(2000) < chance)
    assert result.error - result.expected == pytest.approx(shift, abs=0.04)
    signs = np.sign([result.low, result.high]).tolist()
    assert signs == ([-1, 1] if sign == 0 else [sign, sign])


def test_exact_probabilities_of_few_answers_are_not_said_to_be_wrong():
    rng = np.random.default_rng(2)
    for count, low, high in [(2, 0.5, 0.9), (5, 0.5, 0.9), (12, 0.85, 0.99), (40, 0.95, 0.995)]:
        verdicts = 0
        for _ in range(50):
            chance = rng.uniform(low, high, count)
            result = measured(chance, rng.random(count) < chance)
            verdicts += result.low > 0 or result.high < 0
        assert verdicts <= 4, (count, verdicts)


@pytest.mark.parametrize("correct", [True, False], ids=["all right", "all wrong"])
def test_the_interval_reaches_what_no_group_could_show(correct):
    result = measured(np.full(12, 0.75), [correct] * 12)
    unseen = 1 - 0.025 ** (1 / 12)  # Clopper and Pearson
    if correct:
        expected = (0.75 - 1, unseen - 0.25)
    else:
        expected = (1 - unseen - 0.25, 1 - 0.25)
    assert (result.low, result.high) == pytest.approx(expected)


def test_the_interval_resamples_groups():
    probability = np.full(40, 0.75)
    correct = [1] * 20 + [0] * 20
    alone = measured(probability, correct)
    in_four = measured(probability, correct, np.repeat(range(4), 10))
    assert in_four.high - in_four.low > 2 * (alone.high - alone.low)
    in_one = measured(probability, correct, np.zeros(40))
    assert (in_one.low, in_one.high, in_one.bins[0].high) == (None, None, None)


@pytest.mark.parametrize("order", ["rising", "falling", "mixed"])
def test_equal_probabilities_are_in_one_bin(order):
    probability = np.r_[np.linspace(0.5, 0.9, 39), np.full(61, 1.0)]
    orders = {
        "rising": np.arange(100),
        "falling": np.arange(100)[::-1],
        "mixed": np.random.default_rng(0).permutation(100),
    }
    index = orders[order]
    bins = measured(probability[index], index >= 39).bins
    assert bins[-1].answers == 61
    assert bins[-1].error == 0
    assert bins[-1].expected == 0
    assert sum(part.answers for part in bins) == 100
    expected = [part.expected for part in bins]
    assert expected == sorted(expected, reverse=True)


@pytest.mark.parametrize(
    ("count", "bins"),
    [(1, 1), (2 * ANSWERS - 1, 1), (2 * ANSWERS, 2), (BINS * ANSWERS, BINS), (1000, BINS)],
)
def test_bins_of_different_probabilities_have_about_the_same_size(count, bins):
    result = measured(np.linspace(0.55, 0.9, count), np.ones(count)).bins
    sizes = [part.answers for part in result]
    assert (len(sizes), sum(sizes)) == (bins, count)
    assert max(sizes) - min(sizes) <= 1
