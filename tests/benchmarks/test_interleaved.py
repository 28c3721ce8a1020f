"""Interleaved timing: whose turn it is, and what a ratio is."""

import time

import numpy as np
import pytest

from benchmarks import interleaved


def test_variants_take_turns_and_the_slower_one_is_told(monkeypatch):
    monkeypatch.setattr(interleaved, "BLOCK", 1e-4)
    order = []

    def variant(name, seconds):
        def call():
            order.append(name)
            time.sleep(seconds)

        return call

    variants = {"fast": variant("fast", 1e-3), "plain": variant("plain", 2e-2)}
    seconds = interleaved.interleaved(variants, rounds=3)
    changes = [name for name, before in zip(order, [None, *order], strict=False) if name != before]
    assert changes == ["fast", "plain"] * 3
    assert seconds["fast"].shape == seconds["plain"].shape == (3,)
    assert (seconds["fast"] >= 1e-3).all() and (seconds["plain"] >= 2e-2).all()  # a sleep is never shorter


def test_a_ratio_is_the_median_of_the_rounds_ratios():
    seconds, other = np.array([2.5, 2.0, 3.0]), np.array([0.5, 1.0, 2.0])
    assert interleaved.median_ratio(seconds, other) == pytest.approx(2.0)  # of 5, 2, 1.5; of the medians it is 2.5
