"""The member `convolutions`: random convolutions over time, and ridge regression on them.

MiniRocket (Dempster, Schmidt and Webb, arXiv 2012.08791). Each of the 84 kernels has nine weights:
three are 2, the others are -1. A kernel is dilated, and it reads the sum of up to nine random
channels. Its features are the shares of the recording in which its value exceeds each of its
biases.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, Self

import numpy as np
from scipy.special import softmax

from tactile_viewgcn.members.estimators import Arrays, Estimator, sampled
from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.of_readings import MemberOfReadings
from tactile_viewgcn.members.representation import Representation

LENGTH = 9  # number of weights of a kernel
# places of the weights that are 2, for each kernel
PLACES = np.array(list(combinations(range(LENGTH), 3)))
FEATURES = 10_000
MOST_DILATIONS = 8
MOST_CHANNELS = 9  # most channels that a kernel adds
SAMPLE = 20  # number of recordings whose quantiles become the biases
GOLDEN = (5**0.5 + 1) / 2  # the fractional parts of its multiples cover 0 to 1 evenly
PENALTIES = np.logspace(-3, 3, 10)  # of ridge regression; leaving one recording out chooses one
# factor before the softmax of the regression's values, which are -1 for a wrong class and 1 for the
# right one
RIDGE_SHARPNESS = 4.0


class ConvolutionsMember(MemberOfReadings):
    """Answers only whole recordings, since convolutions need the order of time.

    Attributes:
        convolutions: computes the features. Its biases are measured on training recordings, without
            their labels.
    """

    name = "convolutions"

    def __init__(self, representation: Representation, classes: int):
        super().__init__(representation, classes)
        self.convolutions = RandomConvolutions()

    def measure(self, examples: Examples, *, seed: int) -> None:
        """Draw the convolutions, and measure their biases on a sample of the recordings."""
        recordings = np.random.default_rng(seed).permutation(len(examples.labels))[:SAMPLE]
        sample = [examples.readings(recording) for recording in recordings.tolist()]
        self.convolutions.fit(sample, seed)

    def estimator(self, *, quick: bool = False) -> "Ridge":
        """See `MemberOfReadings.estimator`."""
        return Ridge()

    def recording_points(self, readings: np.ndarray) -> np.ndarray:
        """See `MemberOfReadings.recording_points`."""
        return np.stack([self.convolutions.features(recording) for recording in readings])

    def state_dict(self) -> dict[str, Any]:
        """See `Member.state_dict`."""
        return {**super().state_dict(), "convolutions": self.convolutions.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """See `Member.load_state_dict`."""
        super().load_state_dict(state)
        self.convolutions.load_state_dict(state["convolutions"])


class RandomConvolutions(Arrays):
    """Features of recordings, fitted without labels.

    A recording is padded with zeros before its first frame and after its last.

    Attributes:
        dilations: (D,), the number of frames from one weight of a kernel to the next.
        channels: bool (D, N, S), the channels that each of N kernels adds.
        biases: (D, N, B), the B biases of each kernel.
    """

    def fit(self, recordings: Sequence[np.ndarray], seed: int) -> Self:
        """Choose dilations and channels, and measure the biases on some of the recordings.

        Args:
            recordings: readings (T, S) of each recording.
            seed: seed of the random choices.
        """
        rng = np.random.default_rng(seed)
        drawn = rng.permutation(len(recordings))[:SAMPLE]
        sample = [recordings[recording] for recording in drawn.tolist()]
        median_length = int(np.median([len(readings) for readings in sample]))
        longest_dilation = max(1, (median_length - 1) // (LENGTH - 1))
        dilations = np.geomspace(1, longest_dilation, MOST_DILATIONS).astype(int)
        self.dilations = np.unique(dilations)
        kernels = (len(self.dilations), len(PLACES))
        self.channels = _random_channels(kernels, sample[0].shape[1], rng)
        biases_of_kernel = max(1, FEATURES // (kernels[0] * kernels[1]))
        quantiles = np.arange(1, 1 + biases_of_kernel) * GOLDEN % 1
        biases = []
        for dilation, channels in zip(self.dilations, self.channels, strict=True):
            values = [_convolved(readings, dilation, channels) for readings in sample]
            biases.append(np.quantile(np.concatenate(values, axis=1), quantiles, axis=1).T)
        self.biases = np.stack(biases).astype(np.float32, order="C")
        return self

    def features(self, readings: np.ndarray) -> np.ndarray:
        """Return float32 (D N B,), the share of frames above each bias, of readings (T, S)."""
        shares = []
        for dilation, channels, biases in zip(
            self.dilations, self.channels, self.biases, strict=True
        ):
            values = np.sort(_convolved(readings, dilation, channels), axis=1)
            frames = values.shape[1]
            not_above = []
            for values_of_kernel, biases_of_kernel in zip(values, biases, strict=True):
                not_above.append(np.searchsorted(values_of_kernel, biases_of_kernel, side="right"))
            shares.append(1 - np.concatenate(not_above) / frames)
        return np.concatenate(shares).astype(np.float32)


def _random_channels(
    kernels: tuple[int, int], channels: int, rng: np.random.Generator
) -> np.ndarray:
    """Return up to nine random channels for each kernel, bool (D, N, channels).

    Small numbers of channels are drawn more often than large ones.

    Args:
        kernels: D, the number of dilations, and N, the number of kernels of each.
        channels: number of all channels.
        rng: draws the channels.
    """
    most = min(channels, MOST_CHANNELS)
    sizes = (2 ** rng.uniform(0, np.log2(most + 1), (*kernels, 1))).astype(int)
    rank = rng.random((*kernels, channels)).argsort(axis=2).argsort(axis=2)
    return rank < sizes


def _convolved(readings: np.ndarray, dilation: int, channels: np.ndarray) -> np.ndarray:
    """Return the values float32 (84, T) of all kernels with one dilation.

    The sums are in float64. So a value that equals a bias stays equal to it, whatever the order in
    which a processor adds.

    Args:
        readings: (T, S).
        dilation: number of frames from one weight to the next.
        channels: bool (84, S), the channels of each kernel.
    """
    summed = channels.astype(np.float64) @ readings.T.astype(np.float64)
    frames = summed.shape[1]
    reach = LENGTH // 2 * int(dilation)
    padded = np.pad(summed, ((0, 0), (reach, reach)))
    moved = np.stack([padded[:, place * dilation :][:, :frames] for place in range(LENGTH)])
    # the weights are 3 at three places, minus 1 everywhere
    at_places = moved[PLACES.T, np.arange(len(PLACES))].sum(axis=0)
    values: np.ndarray = 3 * at_places - moved.sum(axis=0)
    return values.astype(np.float32)


class Ridge(Estimator):
    """Ridge regression of the classes' indicators on standardised points, followed by a softmax.

    Attributes:
        weights: (F, K), for points that are not standardised.
        offsets: (K,).
    """

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        """See `Estimator.fit`."""
        from sklearn.linear_model import RidgeCV

        points, labels = sampled(points, labels, seed)
        mean = points.mean(axis=0, dtype=np.float64)
        spread = points.std(axis=0, dtype=np.float64)
        spread = np.where(spread > 0, spread, 1)
        self.classes = np.unique(labels)
        indicators = np.where(labels[:, None] == self.classes, 1.0, -1.0)
        fitted = RidgeCV(PENALTIES).fit((points - mean) / spread, indicators)
        weights = fitted.coef_.T / spread[:, None]
        self.weights = weights.astype(np.float32, order="C")
        self.offsets = (fitted.intercept_ - mean @ weights).astype(np.float32)
        return self

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """See `Estimator.predict_proba`."""
        values = points @ self.weights + self.offsets
        answers: np.ndarray = softmax(RIDGE_SHARPNESS * values, axis=1)
        return answers
