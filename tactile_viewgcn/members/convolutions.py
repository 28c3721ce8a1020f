"""Random convolutions over time, and a ridge classifier on them: MiniRocket (Dempster et al., arXiv 2012.08791).

The 84 kernels have nine weights, three of them 2 and the others -1. Each is dilated and reads the
sum of up to nine channels at random; its features are the shares of the recording in which it
exceeds each of its biases.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import Self

import numpy as np
from scipy.special import softmax

from tactile_viewgcn.members.estimators import Arrays, Estimator, sampled

LENGTH = 9
PLACES = np.array(list(combinations(range(LENGTH), 3)))  # of the weights 2 in each kernel
FEATURES, MOST_DILATIONS, MOST_CHANNELS = 10_000, 8, 9
SAMPLE = 20  # recordings whose quantiles are the biases
GOLDEN = (5**0.5 + 1) / 2  # its multiples, less their whole parts, cover 0 to 1 evenly
PENALTIES = np.logspace(-3, 3, 10)  # of ridge regression, chosen by leaving one recording out
# of the softmax of its values, which are -1 for a wrong class and 1 for the right one
SHARPNESS = 4.0


class Convolutions(Arrays):
    """The features of recordings, fitted without labels; before and after a recording are zeros.

    Attributes:
        dilations: (D,) frames between a kernel's weights.
        channels: bool (D, N, F) channels that each kernel adds.
        biases: (D, N, B).
    """

    def fit(self, recordings: Sequence[np.ndarray], seed: int) -> Self:
        """Draw dilations and channels for recordings of readings (T, F), and measure the biases on some of them."""
        rng = np.random.default_rng(seed)
        drawn = rng.permutation(len(recordings))[:SAMPLE]
        sample = [recordings[number] for number in drawn.tolist()]
        longest, sensors = int(np.median([len(each) for each in sample])), sample[0].shape[1]
        most = max(1, (longest - 1) // (LENGTH - 1))
        self.dilations = np.unique(np.geomspace(1, most, MOST_DILATIONS).astype(int))
        shape, most = (len(self.dilations), len(PLACES)), min(sensors, MOST_CHANNELS)
        sizes = (2 ** rng.uniform(0, np.log2(most + 1), (*shape, 1))).astype(int)
        self.channels = rng.random((*shape, sensors)).argsort(axis=2).argsort(axis=2) < sizes
        quantiles = np.arange(1, 1 + max(1, FEATURES // (shape[0] * shape[1]))) * GOLDEN % 1
        biases = [
            np.quantile(
                np.concatenate([self._convolved(each, *pair) for each in sample], axis=1),
                quantiles,
                axis=1,
            ).T
            for pair in zip(self.dilations, self.channels, strict=True)
        ]
        self.biases = np.stack(biases).astype(np.float32)
        return self

    def features(self, readings: np.ndarray) -> np.ndarray:
        """Shares float32 (D N B,) of the frames of a recording of readings (T, F)."""
        shares = []
        for dilation, channels, biases in zip(
            self.dilations, self.channels, self.biases, strict=True
        ):
            values = np.sort(self._convolved(readings, dilation, channels), axis=1)
            below = [
                np.searchsorted(*pair, side="right") for pair in zip(values, biases, strict=True)
            ]
            shares.append(1 - np.concatenate(below) / values.shape[1])
        return np.concatenate(shares).astype(np.float32)

    def _convolved(self, readings: np.ndarray, dilation: int, channels: np.ndarray) -> np.ndarray:
        """Values float32 (84, T) of all kernels with one dilation.

        The sums are in float64, so that a value that equals a bias does so in whatever order a
        processor adds.
        """
        summed, reach = (
            channels.astype(np.float64) @ readings.T.astype(np.float64),
            LENGTH // 2 * int(dilation),
        )
        padded = np.pad(summed, ((0, 0), (reach, reach)))
        moved = np.stack(
            [padded[:, place * dilation :][:, : summed.shape[1]] for place in range(LENGTH)]
        )
        return (3 * moved[PLACES.T, np.arange(len(PLACES))].sum(axis=0) - moved.sum(axis=0)).astype(
            np.float32
        )


class Ridge(Estimator):
    """Ridge regression of the classes' indicators on standardised points; probabilities by softmax.

    Attributes:
        weights: (F, K), offsets: (K,) of points as they are.
    """

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        from sklearn.linear_model import RidgeCV

        points, labels = sampled(points, labels, seed)
        mean, spread = points.mean(axis=0, dtype=np.float64), points.std(axis=0, dtype=np.float64)
        spread = np.where(spread > 0, spread, 1)
        self.classes = np.unique(labels)
        indicators = np.where(labels[:, None] == self.classes, 1.0, -1.0)
        fitted = RidgeCV(PENALTIES).fit((points - mean) / spread, indicators)
        weights = fitted.coef_.T / spread[:, None]
        self.weights = weights.astype(np.float32, order="C")
        self.offsets = (fitted.intercept_ - mean @ weights).astype(np.float32)
        return self

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        return softmax(SHARPNESS * (points @ self.weights + self.offsets), axis=1)
