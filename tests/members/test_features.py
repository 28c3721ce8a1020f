"""Statistics of recordings and view sets against naive loops and cases worked by hand."""

import math
from itertools import pairwise
from statistics import fmean, median, pstdev

import numpy as np
import pytest
from scipy import sparse

from tactile_viewgcn.members import features

READINGS = np.random.default_rng(0).normal(size=(2, 43, 3))  # two recordings of three channels


def in_general(readings):
    """Return the mean, spread and change of a list of readings."""
    changes = [abs(after - before) for before, after in pairwise(readings)]
    change = fmean(changes or [0])
    return [fmean(readings), math.log(pstdev(readings) + 0.05), math.log(change + 0.05)]


def statistics(channel):
    """Return the 21 statistics of a channel, which is a list of readings."""
    count = len(channel)
    tenth = max(1, count // 10)
    mean, spread, change = in_general(channel)
    time = [0]
    if count > 1:
        time = [2 * frame / (count - 1) - 1 for frame in range(count)]
    product = sum(t * reading for t, reading in zip(time, channel, strict=True))
    slope = product / max(1, sum(t * t for t in time))
    numbers = [mean, spread, min(channel), max(channel), median(channel), change, slope]
    numbers += [fmean(channel[:tenth]), fmean(channel[count - tenth :])]
    for window in range(4):
        begin = window * count // 4
        end = (window + 1) * count // 4
        numbers += in_general(channel[begin : max(end, begin + 1)])
    return numbers


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 10, 43])
def test_statistics_of_recordings_by_naive_loops(frames):
    readings = READINGS[:, :frames]
    points = features.in_windows(readings)
    by_statistic = points.reshape(2, 21, 3)
    for recording, channel in np.ndindex(2, 3):
        expected = statistics(readings[recording, :, channel].tolist())
        actual = by_statistic[recording, :, channel]
        np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-12)
    assert (features.in_time(readings) == points[:, :27]).all()


def test_points_of_an_array_by_hand():
    """Weak readings are noise.

    For two sensors, log(1 + x - 2) is 0 and log 2 in the first frame, and 0 and log 8 in the
    second.
    """
    expected = [-math.log(4), 0, 0, 0, math.log(2), math.log(4)]
    np.testing.assert_allclose(features.pressed(np.array([-5.0, -2, 0, 2, 3, 5])), expected)
    readings = np.array([[[2.0, 3.0], [2.0, 9.0]]])
    block = sparse.csr_array(np.full((2, 1), 0.5))
    expected = math.log(2) * np.array([[0, 2, 1, 0, 3, 1.5]])
    np.testing.assert_allclose(features.array_maps(readings, block), expected)


@pytest.mark.parametrize("shape", [(6, 6), (5, 7), (8, 3), (9, 11), (4, 16)])
def test_blocks_are_the_squares_of_any_glove(shape):
    """A naive loop finds the squares with at least half of their cells live.

    The width need not be a multiple of the block.
    """
    live = np.random.default_rng(0).random(shape) < 0.7
    rows, columns = np.nonzero(live)
    expected = []
    for size in features.BLOCKS:
        height = math.ceil(shape[0] / size)
        width = math.ceil(shape[1] / size)
        for top, left in np.ndindex(height, width):
            inside = (rows // size == top) & (columns // size == left)
            if inside.sum() >= size**2 / 2:
                expected.append(inside / inside.sum())
    weights = features.block_weights(live).toarray()
    np.testing.assert_allclose(weights, np.transpose(expected), rtol=1e-6)


def test_the_weights_of_the_largest_array_fit_memory():
    """Each of the 256 x 256 sensors is in one block of each size; only these weights are stored."""
    weights = features.block_weights(np.ones((256, 256), dtype=bool))
    assert weights.shape == (256**2, 128**2 + 64**2 + 32**2)
    assert weights.nnz == 3 * 256**2
