"""Pictures: what is drawn is what was given."""

import io

import numpy as np
import pytest

from tactile_viewgcn.plots import cluster_means, confusion, curves

PNG = b"\x89PNG"


def png(figure):
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()


def names(ticks):
    return [tick.get_text() for tick in ticks]


def test_confusion_is_drawn_as_shares_of_each_row():
    figure = confusion(np.array([[3, 1, 0], [0, 0, 0], [2, 2, 4]]), ["cup", "a_b", "tape"], "object protocol")
    axes = figure.axes[0]
    np.testing.assert_allclose(axes.images[0].get_array(), [[0.75, 0.25, 0], [0, 0, 0], [0.25, 0.25, 0.5]])
    assert axes.images[0].get_clim() == (0, 1)
    assert names(axes.get_xticklabels()) == names(axes.get_yticklabels()) == ["cup", "a_b", "tape"]
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_title()) == ("predicted", "held", "object protocol")
    assert png(figure).startswith(PNG)


@pytest.mark.parametrize("count", [2, 27])
def test_confusion_of_few_and_of_many_classes_can_be_drawn(count):
    assert png(confusion(np.eye(count), ["safety_glasses"] * count, "t")).startswith(PNG)


def test_curves_are_a_line_each_over_the_epochs():
    axes = curves({"loss": [2.0, 1.0, 0.5], "validation_error": [0.75, 0.5, 0.25]}, "finetune").axes[0]
    assert [line.get_label() for line in axes.lines] == ["loss", "validation_error"]
    for line, values in zip(axes.lines, ([2.0, 1.0, 0.5], [0.75, 0.5, 0.25]), strict=True):
        assert line.get_xdata().tolist() == [1, 2, 3]
        assert line.get_ydata().tolist() == values
    assert axes.get_xlabel() == "epoch"


def test_a_single_epoch_can_be_drawn():
    assert png(curves({"loss": [1.0]}, "pretrain")).startswith(PNG)


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


@pytest.mark.parametrize("shape", [(2, 1, 12, 12), (27, 8, 4, 4), (3, 20, 1, 1)])
def test_cluster_means_can_be_drawn_for_few_and_many_views(shape):
    figure = cluster_means(np.ones(shape), np.ones(shape[2:], dtype=bool), ["multimeter"] * shape[0])
    assert png(figure).startswith(PNG)


def test_cluster_means_of_silent_sensors_can_be_drawn():
    figure = cluster_means(np.zeros((2, 2, 3, 3)), np.ones((3, 3), dtype=bool), ["cup", "pen"])
    assert figure.axes[0].images[0].get_clim() == (0, 1)
    assert png(figure).startswith(PNG)
