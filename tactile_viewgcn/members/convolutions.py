"""The member `convolutions`: random convolutions over time, and ridge regression on them.

MiniRocket (Dempster, Schmidt and Webb, arXiv 2012.08791). The 84 kernels have nine weights, three
of them 2 and the others -1. Each is dilated and reads the sum of up to nine channels at random; its
features are the shares of the recording in which it exceeds each of its biases.
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

LENGTH = 9  # weights of a kernel
# places of the weights 2 in each kernel
PLACES = np.array(list(combinations(range(LENGTH), 3)))
FEATURES = 10_000
MOST_DILATIONS = 8
MOST_CHANNELS = 9  # that a kernel adds
SAMPLE = 20  # recordings whose quantiles are the biases
GOLDEN = (5**0.5 + 1) / 2  # its multiples, less their whole parts, cover 0 to 1 evenly
PENALTIES = np.logspace(-3, 3, 10)  # of ridge regression, chosen by leaving one recording out
# of the softmax of the regression's values: -1 for a wrong class and 1 for the right one
RIDGE_SHARPNESS = 4.0


class ConvolutionsMember(MemberOfReadings):
    """Answers whole recordings only: convolutions need the order of time.

    Attributes:
        convolutions: the features, measured on all training recordings without their labels.
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
    """Features of recordings, fitted without labels; before and after a recording are zeros.

    Attributes:
        dilations: (D,) frames between a kernel's weights.
        channels: bool (D, N, S), the channels that each of N kernels adds.
        biases: (D, N, B), the B biases of each kernel.
    """

    def fit(self, recordings: Sequence[np.ndarray], seed: int) -> Self:
        """Draw dilations and channels, and measure the biases on some of the recordings.

        Args:
            recordings: readings (T, S) of each recording.
            seed: of the draws.
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
        """Return float32 (D N B,), the shares of the frames of readings (T, S) above each bias."""
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
    """Up to nine random channels of each kernel, bool (D, N, channels); few more often than many.

    Args:
        kernels: D dilations, and N kernels of each.
        channels: number of all channels.
        rng: of the draws.
    """
    most = min(channels, MOST_CHANNELS)
    sizes = (2 ** rng.uniform(0, np.log2(most + 1), (*kernels, 1))).astype(int)
    rank = rng.random((*kernels, channels)).argsort(axis=2).argsort(axis=2)
    return rank < sizes


def _convolved(readings: np.ndarray, dilation: int, channels: np.ndarray) -> np.ndarray:
    """Values float32 (84, T) of all kernels with one dilation.

    The sums are in float64, so that a value that equals a bias does so in whatever order a
    processor adds.

    Args:
        readings: (T, S).
        dilation: frames between weights.
        channels: bool (84, S), the channels of each kernel.
    """
    summed = channels.astype(np.float64) @ readings.T.astype(np.float64)
    frames = summed.shape[1]
    reach = LENGTH // 2 * int(dilation)
    padded = np.pad(summed, ((0, 0), (reach, reach)))
    moved = np.stack([padded[:, place * dilation :][:, :frames] for place in range(LENGTH)])
    # the weights are 3 at three places, less 1 everywhere
    at_places = moved[PLACES.T, np.arange(len(PLACES))].sum(axis=0)
    values: np.ndarray = 3 * at_places - moved.sum(axis=0)
    return values.astype(np.float32)


class Ridge(Estimator):
    """Ridge regression of the classes' indicators on standardised points; softmax of its values.

    Attributes:
        weights: (F, K), of points as they are.
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
