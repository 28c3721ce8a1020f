"""Pictures: what is drawn is what was given."""

import numpy as np

from tactile_viewgcn.plots import cluster_means, confusions, curves, error_intervals, mean_frames, time_lines


def names(ticks):
    return [tick.get_text() for tick in ticks]


def test_confusions_are_drawn_as_shares_of_each_row_side_by_side():
    counts = {"object": np.array([[3, 1, 0], [0, 0, 0], [2, 2, 4]]), "recording": np.eye(3, dtype=int)}
    left, right = confusions(counts, ["cup", "a_b", "tape"]).axes[:2]
    np.testing.assert_allclose(left.images[0].get_array(), [[0.75, 0.25, 0], [0, 0, 0], [0.25, 0.25, 0.5]])
    np.testing.assert_allclose(right.images[0].get_array(), np.eye(3))
    assert left.images[0].get_clim() == (0, 1)
    assert names(left.get_xticklabels()) == names(left.get_yticklabels()) == ["cup", "a_b", "tape"]
    assert (left.get_xlabel(), left.get_ylabel()) == ("predicted", "held")
    assert "object" in left.get_title() and "recording" in right.get_title()


def test_cluster_means_lie_in_a_row_per_class_with_a_gap_between():
    means = np.random.default_rng(0).random((2, 3, 4, 5))
    live = np.ones((4, 5), dtype=bool)
    live[0, 0] = False
    figure = cluster_means(means, live, ["cup", "pen"])
    axes = figure.axes[0]
    mosaic = np.ma.filled(axes.images[0].get_array().astype(float), np.nan)
    assert mosaic.shape == (2 * 5, 3 * 6)
    for row in range(2):
        for column in range(3):
            tile = mosaic[5 * row : 5 * row + 4, 6 * column : 6 * column + 5]
            np.testing.assert_array_equal(tile[live], means[row, column][live])
            assert np.isnan(tile[0, 0])
    assert np.isnan(mosaic[4::5]).all()
    assert np.isnan(mosaic[:, 5::6]).all()
    assert names(axes.get_yticklabels()) == ["cup", "pen"]
    assert names(axes.get_xticklabels()) == ["0", "1", "2"]


def test_cluster_means_of_silent_sensors_can_be_drawn():
    figure = cluster_means(np.zeros((2, 2, 3, 3)), np.ones((3, 3), dtype=bool), ["cup", "pen"])
    assert figure.axes[0].images[0].get_clim() == (0, 1)


def test_mean_frames_share_one_scale_and_leave_out_what_is_no_sensor():
    frames, live = np.arange(24.0).reshape(2, 3, 4), np.ones((3, 4), dtype=bool)
    live[0, 0] = False
    figure = mean_frames(frames, live, ["$x$", "a name that is much too long for it"], "counts")
    left, right = (axes.images[0] for axes in figure.axes[:2])
    assert left.get_clim() == right.get_clim() and np.ma.getmaskarray(left.get_array())[0, 0]
    assert [axes.get_title() for axes in figure.axes[:2]] == ["$x$", "a name that is much t…"]


def test_errors_stand_with_their_intervals_and_guessing():
    errors = {"recording": {"mean": 0.4, "low": 0.3, "high": 0.6}, "object": {"mean": 0.2, "low": None, "high": None}}
    (axes,) = error_intervals(errors, chance=0.9).axes
    assert names(axes.get_yticklabels()) == ["recording", "object"]
    drawn = [line.get_xdata() for line in axes.lines]
    assert [list(line) for line in drawn] == [[30, 60], [40], [20], [90, 90]]


def test_curves_have_a_panel_for_each_quantity():
    loss, error = curves({"loss": [3.0, 2.0], "validation_error": [0.5, 0.4]}, "pretrain").axes
    np.testing.assert_allclose(loss.lines[0].get_xydata(), [[1, 3], [2, 2]])
    assert error.get_title() == "pretrain: validation error"


def test_time_lines_count_seconds_where_there_are_some():
    line, held = np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.0, 0.0])
    timed = time_lines([line], [held], [4.0], ["mug"]).axes[0]
    np.testing.assert_allclose(timed.lines[0].get_xdata(), [0, 2, 4])
    figure = time_lines([line] * 4, [held] * 4, [np.nan] * 4, ["mug"] * 4)
    assert figure.get_supxlabel() == "share of the recording" and [axes.get_visible() for axes in figure.axes][4:] == [
        False,
        False,
    ]
