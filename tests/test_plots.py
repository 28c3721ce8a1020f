"""Pictures show the numbers that they are given."""

import numpy as np
import pytest

from tactile_viewgcn.plots import confusion, errors_by_frames


def names(ticks):
    return [tick.get_text() for tick in ticks]


def test_confusion_is_drawn_as_shares_of_each_row():
    axes = confusion(np.array([[3, 1, 0], [0, 0, 0], [2, 2, 4]]), ["cup", "a_b", "tape"]).axes[0]
    np.testing.assert_allclose(
        axes.images[0].get_array(), [[0.75, 0.25, 0], [0, 0, 0], [0.25, 0.25, 0.5]]
    )
    assert names(axes.get_xticklabels()) == names(axes.get_yticklabels()) == ["cup", "a_b", "tape"]
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.images[0].get_clim()) == (
        "predicted",
        "object",
        (0, 1),
    )


def test_errors_stand_over_the_number_of_frames():
    ends = [
        (1, {"mean": 0.4, "low": 0.3, "high": 0.6}),
        (2, {"mean": 0.2, "low": None, "high": None}),
    ]
    (axes,) = errors_by_frames({"recording": ends}, chance=0.9).axes
    assert [list(values) for values in axes.lines[0].get_data()] == [[1, 2], [40, 20]]
    # the band
    assert axes.collections[0].get_datalim(axes.transData).intervaly == pytest.approx([30, 60])
    assert list(axes.lines[1].get_ydata()) == [90, 90]
    assert names(axes.get_xticklabels()) == ["1", "2"] and names(axes.get_legend().texts) == [
        "recording",
        "chance",
    ]
