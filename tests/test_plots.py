"""Pictures show the numbers that they are given."""

import numpy as np
import pytest

from tactile_viewgcn.plots import confusion, errors_by_frames, live_errors


def names(ticks):
    return [tick.get_text() for tick in ticks]


def test_confusion_is_drawn_as_shares_of_each_row():
    axes = confusion(np.array([[3, 1, 0], [0, 0, 0], [2, 2, 4]]), ["cup", "a_b", "tape"]).axes[0]
    (image,) = axes.images
    np.testing.assert_allclose(image.get_array(), [[0.75, 0.25, 0], [0, 0, 0], [0.25, 0.25, 0.5]])
    assert image.get_clim() == (0, 1)
    assert names(axes.get_xticklabels()) == names(axes.get_yticklabels()) == ["cup", "a_b", "tape"]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("predicted", "object")


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
    assert names(axes.get_xticklabels()) == ["1", "2"]
    assert names(axes.get_legend().texts) == ["recording", "chance"]


def live_row(answer, level, error, **others):
    row = {"answer": answer, "level": level, "error": error, "low": 0.1, "high": 0.9}
    return row | {"share": 0.5, "contact": None, "unit": "s"} | others


def test_live_errors_stand_over_the_time_of_contact():
    rows = [
        live_row("so far", 0.25, 0.8),
        live_row("so far", 0.5, 0.4, low=None, high=None),
        live_row("final", None, 0.2, contact=1.5),
        live_row("sure", 0.8, 0.1, contact=0.3),
        live_row("sure", 0.9, None),
        live_row("predict", None, 0.15, unit=None),
    ]
    (axes,) = live_errors(rows, chance=0.9).axes
    stream, sure, predict, chance = axes.lines
    assert [list(values) for values in stream.get_data()] == [[0.25, 0.5, 1], [80, 40, 20]]
    assert [list(values) for values in sure.get_data()] == [[0.3], [10]]
    assert list(predict.get_ydata()) == [15, 15] and list(chance.get_ydata()) == [90, 90]
    assert names(axes.get_xticklabels()) == ["0.25", "0.5", "end"]
    assert names(axes.texts) == ["80 %"] and axes.get_xlabel() == "seconds of contact"


def test_live_errors_of_recordings_without_times_stand_over_frames():
    rows = [
        live_row("so far", 1, 0.8, unit="frames"),
        live_row("final", None, 0.2, unit="frames"),
        live_row("predict", None, 0.15, unit=None),
    ]
    (axes,) = live_errors(rows, chance=0.9).axes
    assert axes.get_xlabel() == "frames of contact" and len(axes.lines) == 3


def test_live_errors_have_no_line_of_predict_if_it_was_not_measured():
    rows = [live_row("so far", 0.25, 0.8), live_row("final", None, 0.2, contact=1.5)]
    (axes,) = live_errors(rows, chance=0.9).axes
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["answers so far", "chance"]
