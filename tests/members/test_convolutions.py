"""Random convolutions over time against a naive loop."""

from itertools import combinations

import numpy as np
import pytest

from tactile_viewgcn.members.convolutions import FEATURES, GOLDEN, RandomConvolutions


def convolved(series, places, dilation, frame):
    """Return the sum of nine weighted values around a frame of a series.

    The weights are 2 at the places and -1 elsewhere. Beyond its ends, the series is 0.
    """
    total = 0
    for place in range(9):
        index = frame + (place - 4) * dilation
        weight = 2 if place in places else -1
        if 0 <= index < len(series):
            total += weight * series[index]
    return total


@pytest.mark.parametrize("frames", [1, 5, 8, 30])
def test_features_are_the_shares_above_the_biases_by_naive_loops(frames):
    """All numbers are whole, so that some values are equal to a bias, which is not above it."""
    rng = np.random.default_rng(0)
    readings = rng.integers(-5, 6, size=(frames, 4))
    biases = rng.integers(-20, 21, size=(2, 84, 5))
    channels = rng.random((2, 84, 4)) < 0.5
    expected = []
    for i, dilation in enumerate((1, 3)):
        for kernel, places in enumerate(combinations(range(9), 3)):
            series = readings[:, channels[i, kernel]].sum(axis=1).tolist()
            values = [convolved(series, places, dilation, frame) for frame in range(frames)]
            for bias in biases[i, kernel]:
                expected.append(sum(value > bias for value in values) / frames)
    state = {"dilations": np.array([1, 3]), "channels": channels, "biases": biases}
    convolutions = RandomConvolutions().load_state_dict(state)
    np.testing.assert_allclose(convolutions.features(readings), expected, atol=1e-6)


def test_biases_are_quantiles_so_that_known_shares_of_the_fitted_recordings_are_above_them():
    """The shares are right even if all recordings of one object come before the other's.

    The readings of the second object are nine times as large as the first's.
    """
    recordings = np.random.default_rng(0).normal(size=(40, 100, 11))
    recordings[20:] *= 9
    convolutions = RandomConvolutions().fit(recordings, 0)
    # eight from 1 to 99 / 8, with evenly spaced logarithms, rounded down
    assert convolutions.dilations.tolist() == [1, 2, 4, 5, 8, 12]
    assert set(convolutions.channels.sum(axis=2).ravel()) == set(range(1, 10))  # of eleven channels
    features = [convolutions.features(recording) for recording in recordings]
    shares = np.mean(features, axis=0).reshape(convolutions.biases.shape)
    biases_of_a_kernel = FEATURES // (6 * 84)
    quantiles = np.arange(1, biases_of_a_kernel + 1) * GOLDEN % 1
    np.testing.assert_allclose(shares, 1 - np.broadcast_to(quantiles, shares.shape), atol=0.08)
