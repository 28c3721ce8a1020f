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
        at = frame + (place - 4) * dilation
        total += (2 if place in places else -1) * (series[at] if 0 <= at < len(series) else 0)
    return total


@pytest.mark.parametrize("frames", [1, 5, 8, 30])
def test_features_are_the_shares_above_the_biases_by_naive_loops(frames):
    """All numbers are whole, so that some values are equal to a bias, which is not above it."""
    rng, found = np.random.default_rng(0), []
    readings, biases = rng.integers(-5, 6, size=(frames, 4)), rng.integers(-20, 21, size=(2, 84, 5))
    channels = rng.random((2, 84, 4)) < 0.5
    for number, dilation in enumerate((1, 3)):
        for kernel, places in enumerate(combinations(range(9), 3)):
            series = readings[:, channels[number, kernel]].sum(axis=1).tolist()
            values = [convolved(series, places, dilation, frame) for frame in range(frames)]
            found += [
                sum(value > bias for value in values) / frames for bias in biases[number, kernel]
            ]
    state = {"dilations": np.array([1, 3]), "channels": channels, "biases": biases}
    convolutions = RandomConvolutions().load_state_dict(state)
    np.testing.assert_allclose(convolutions.features(readings), found, atol=1e-6)


def test_biases_are_quantiles_so_that_known_shares_of_the_fitted_recordings_are_above_them():
    """The shares are right even if one object is recorded first, and another then.

    The readings of the second object are nine times as large.
    """
    recordings = (
        np.random.default_rng(0).normal(size=(40, 100, 11)) * np.repeat([1, 9], 20)[:, None, None]
    )
    convolutions = RandomConvolutions().fit(recordings, 0)
    # eight from 1 to 99 / 8, with evenly spaced logarithms, rounded down
    assert convolutions.dilations.tolist() == [1, 2, 4, 5, 8, 12]
    assert set(convolutions.channels.sum(axis=2).ravel()) == set(range(1, 10))  # of eleven channels
    shares = np.mean([convolutions.features(each) for each in recordings], axis=0).reshape(
        convolutions.biases.shape
    )
    quantiles = [number * GOLDEN % 1 for number in range(1, FEATURES // (6 * 84) + 1)]
    np.testing.assert_allclose(shares, 1 - np.broadcast_to(quantiles, shares.shape), atol=0.08)
