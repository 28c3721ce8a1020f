"""The twin: frame statistics of a table counted by hand."""

import numpy as np
import pytest

from benchmarks.twin.statistics import STAG, frame_statistics
from tests.small_tables import small_table


def test_statistics_of_frames_counted_by_hand():
    """Two objects, two recordings of each; every frame of an object presses the same sensor by 10 or 20 counts."""
    table = two_objects()
    numbers = frame_statistics(table, np.random.default_rng(0))
    assert set(numbers) == set(STAG)
    assert numbers["maximum of a frame, median, counts"] == 15
    assert numbers["sensors above 5 counts, median"] == 1
    assert numbers["cosine of two frames of a grasp"] == pytest.approx(1)
    assert numbers["cosine of two grasps of an object"] == pytest.approx(1)
    assert numbers["cosine of two objects"] == 0
