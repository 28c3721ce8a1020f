"""The twin: statistics of frames counted by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.twin.statistics import STAG, frame_statistics


def test_statistics_of_frames_counted_by_hand():
    """A ball presses the first of two sensors by 10 counts, a coin the second by 20; two recordings of three frames."""
    label = np.repeat([1, 2], 6)
    table = SimpleNamespace(
        classes=["empty_hand", "ball", "coin"],
        label=label,
        recording=np.repeat([0, 1, 2, 3], 3),
        grasp=np.zeros(12, dtype=int),
        baseline=np.zeros(12, dtype=int),
        baseline_mean=np.full((1, 1, 2), 500.0),
        counts=500 + np.where(label[:, None] == 1, [10, 0], [0, 20])[:, None],
        live=np.ones((1, 2), dtype=bool),
    )
    numbers = frame_statistics(table, np.random.default_rng(0))
    assert set(numbers) == set(STAG)
    assert numbers["maximum of a frame, median, counts"] == 15
    assert numbers["sensors above 5 counts, median"] == 1
    assert numbers["load of the 50 busiest sensors, %"] == 100
    assert numbers["correlation of activity with weight"] == pytest.approx(-1)  # 55 g and 14 g
    assert numbers["cosine of two frames of a grasp"] == pytest.approx(1)
    assert numbers["cosine of two grasps of an object"] == pytest.approx(1)
    assert numbers["cosine of two objects"] == 0
