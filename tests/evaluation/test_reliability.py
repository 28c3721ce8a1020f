"""How well probabilities agree with errors, on answers whose agreement is known."""

import numpy as np
import pytest

from tactile_viewgcn.evaluation.reliability import BINS, FEWEST, reliability


def answers(confidence):
    """Probabilities of three classes, of which the second is the answer."""
    rest = (1 - np.array(confidence)) / 2
    return np.column_stack([rest, confidence, rest])


def measured(confidence, correct, groups=None):
    correct = np.array(correct, dtype=bool)
    groups = np.arange(len(correct)) if groups is None else np.array(groups)
    return reliability(answers(confidence), correct, groups, np.random.default_rng(0))


def test_the_numbers_are_those_computed_by_hand():
    # the answers with 0.9 are right in 5 of 10 cases, those with 0.5 in 7 of 10, in mixed order
    confidence = [0.9, 0.5] * 10
    correct = [1, 1] * 5 + [0, 1] * 2 + [0, 0] * 3
    found = measured(confidence, correct)
    assert found["probability"] == pytest.approx(0.7)
    assert found["excess"]["mean"] == pytest.approx(0.7 - 12 / 20)
    assert found["calibration_error"] == pytest.approx((0.4 + 0.2) / 2)
    low, high = found["bins"]
    assert (low["answers"], high["answers"]) == (10, 10)
    assert (low["probability"], high["probability"]) == pytest.approx((0.5, 0.9))
    assert (low["right"]["mean"], high["right"]["mean"]) == pytest.approx((0.7, 0.5))
    assert low["right"]["low"] < 0.7 < low["right"]["high"]


def test_equal_probabilities_are_in_one_bin_whichever_order_the_answers_have():
    in_order = [1] * 30 + [0] * 10
    found = measured(np.full(40, 0.75), in_order)
    assert found["calibration_error"] == pytest.approx(0)
    assert [part["answers"] for part in found["bins"]] == [40]


def test_differences_of_two_bins_do_not_cancel():
    found = measured(np.repeat([0.6, 0.8], 10), [1] * 10 + [0] * 5 + [1] * 5)
    assert found["excess"]["mean"] == pytest.approx(0.7 - 0.75)
    assert found["calibration_error"] == pytest.approx((0.4 + 0.3) / 2)


@pytest.mark.parametrize(("shift", "sign"), [(0.0, 0), (0.15, 1), (-0.15, -1)])
def test_the_interval_tells_exact_probabilities_from_others(shift, sign):
    rng = np.random.default_rng(1)
    chance = rng.uniform(0.5, 0.8, 2000)
    excess = measured(chance + shift, rng.random(2000) < chance)["excess"]
    assert excess["mean"] == pytest.approx(shift, abs=0.04)
    ends = np.sign([excess["low"], excess["high"]]).tolist()
    assert ends == ([-1, 1] if sign == 0 else [sign, sign])


def test_the_interval_resamples_groups():
    confidence, correct = np.full(40, 0.75), [1] * 20 + [0] * 20
    alone = measured(confidence, correct)["excess"]
    in_four = measured(confidence, correct, np.repeat(range(4), 10))["excess"]
    assert in_four["high"] - in_four["low"] > 2 * (alone["high"] - alone["low"])
    in_one = measured(confidence, correct, np.zeros(40))
    assert in_one["excess"]["low"] is None and in_one["bins"][0]["right"]["high"] is None


@pytest.mark.parametrize(
    ("count", "bins"),
    [(1, 1), (2 * FEWEST - 1, 1), (2 * FEWEST, 2), (BINS * FEWEST, BINS), (1000, BINS)],
)
def test_bins_have_about_the_same_size_and_at_least_ten_answers(count, bins):
    found = measured(np.linspace(0.4, 0.9, count), np.ones(count))["bins"]
    sizes = [part["answers"] for part in found]
    assert (len(sizes), sum(sizes)) == (bins, count)
    assert max(sizes) - min(sizes) <= 1
