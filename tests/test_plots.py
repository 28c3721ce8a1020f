"""Pictures show the numbers that they are given."""

import numpy as np

from tactile_viewgcn.plots import confusions, errors_by_frames


def names(ticks):
    return [tick.get_text() for tick in ticks]


def test_confusions_are_drawn_as_shares_of_each_row_side_by_side():
    counts = {"object": np.array([[3, 1, 0], [0, 0, 0], [2, 2, 4]]), "recording": np.eye(3, dtype=int)}
    left, right = confusions(counts, ["cup", "a_b", "tape"]).axes[:2]
    np.testing.assert_allclose(left.images[0].get_array(), [[0.75, 0.25, 0], [0, 0, 0], [0.25, 0.25, 0.5]])
    np.testing.assert_allclose(right.images[0].get_array(), np.eye(3))
    assert names(left.get_xticklabels()) == names(left.get_yticklabels()) == ["cup", "a_b", "tape"]


def test_errors_stand_over_the_number_of_frames():
    ends = [(1, {"mean": 0.4, "low": 0.3, "high": 0.6}), (2, {"mean": 0.2, "low": None, "high": None})]
    (axes,) = errors_by_frames({"recording": ends}, chance=0.9).axes
    assert [list(values) for values in axes.lines[0].get_data()] == [[1, 2], [40, 20]]
    assert names(axes.get_xticklabels()) == ["1", "2"] and names(axes.get_legend().texts) == ["recording", "guessing"]
