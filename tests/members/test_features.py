"""Statistics of recordings and view sets against naive loops and cases worked by hand."""

import math
from itertools import pairwise
from statistics import fmean, median, pstdev

import numpy as np
import pytest

from tactile_viewgcn.members import features

READINGS = np.random.default_rng(0).normal(size=(2, 43, 3))  # two recordings of three channels


def in_general(part):
    """Return mean, spread and change of a channel, which is a list of readings."""
    change = fmean([abs(b - a) for a, b in pairwise(part)] or [0])
    return [fmean(part), math.log(pstdev(part) + 0.05), math.log(change + 0.05)]


def statistics(channel):
    """Return the 21 statistics of a channel."""
    count, tenth, (mean, spread, change) = (
        len(channel),
        max(1, len(channel) // 10),
        in_general(channel),
    )
    time = [2 * frame / (count - 1) - 1 for frame in range(count)] if count > 1 else [0]
    slope = sum(t * x for t, x in zip(time, channel, strict=True)) / max(
        1, sum(t * t for t in time)
    )
    numbers = [mean, spread, min(channel), max(channel), median(channel), change, slope]
    numbers += [fmean(channel[:tenth]), fmean(channel[count - tenth :])]
    for window in range(4):
        begin, end = window * count // 4, (window + 1) * count // 4
        numbers += in_general(channel[begin : max(end, begin + 1)])
    return numbers


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 10, 43])
def test_statistics_of_recordings_by_naive_loops(frames):
    expected = [
        [statistics(channel.tolist()) for channel in part.T] for part in READINGS[:, :frames]
    ]
    points = features.in_windows(READINGS[:, :frames])
    np.testing.assert_allclose(
        points.reshape(2, 21, 3), np.swapaxes(expected, 1, 2), rtol=1e-9, atol=1e-12
    )
    assert (features.in_time(READINGS[:, :frames]) == points[:, :27]).all()


def test_points_of_an_array_by_hand():
    """Weak readings are noise.

    For two sensors, log(1 + x - 2) is 0 and log 2 in the first frame, and 0 and log 8 in the
    second.
    """
    log2, expected = math.log(2), [-math.log(4), 0, 0, 0, math.log(2), math.log(4)]
    np.testing.assert_allclose(features.pressed(np.array([-5.0, -2, 0, 2, 3, 5])), expected)
    readings, block = np.array([[[2.0, 3.0], [2.0, 9.0]]]), np.full((2, 1), 0.5)
    np.testing.assert_allclose(
        features.array_maps(readings, block), [[0, 2 * log2, log2, 0, 3 * log2, 1.5 * log2]]
    )


@pytest.mark.parametrize("shape", [(6, 6), (5, 7), (8, 3), (9, 11), (4, 16)])
def test_blocks_are_the_squares_of_any_glove(shape):
    """A naive loop finds the squares with at least half of their cells live.

    The width need not be a multiple of the block.
    """
    live, expected = np.random.default_rng(0).random(shape) < 0.7, []
    rows, columns = np.nonzero(live)
    for size in features.BLOCKS:
        for top, left in np.ndindex(-(-shape[0] // size), -(-shape[1] // size)):
            inside = (rows // size == top) & (columns // size == left)
            if inside.sum() >= size**2 / 2:
                expected.append(inside / inside.sum())
    np.testing.assert_allclose(features.block_weights(live), np.transpose(expected), rtol=1e-6)
