"""What the members of a classifier on the sensors read: scaled readings, and points; it is fitted without labels."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Self

import numpy as np

import tactile_viewgcn.members.features as features
from tactile_viewgcn.members.convolutions import Convolutions, Ridge
from tactile_viewgcn.members.estimators import FEWEST_TREES, TREES, Estimator, Forest
from tactile_viewgcn.members.kernels import KernelRidge, NormalisedVectors, SupportVectors

if TYPE_CHECKING:
    from tactile_viewgcn.tables.counts import Counts

OF_FRAMES = "kernel"  # the member that answers single frames; its probabilities are averaged
MOST_FRAMES, QUICK_FRAMES = 2000, 1000  # that this member is fitted to, and quickly fitted to
NETWORK = "network"  # the member that is a trained network, and the preset that it is trained by
OF_EACH_FRAME = (OF_FRAMES, NETWORK)  # members that answer single frames
#: members that also answer view sets, for which no order counts
OF_SETS = (*OF_EACH_FRAME, "pooled_kernel", "svm")
# times finer is the unit of the members `IN_FINER` on an array, and so narrower its dead zone
FINER = 10.0
IN_FINER = ("svm", "trees")
FARTHEST = 1e15  # scaled reading: its square is in the range of single precision
# of the readings in contact are above PRESSED_UNITS; with STAG's glove these are four counts
PRESSED_SHARE = 0.1
PRESSED_UNITS = 4.0
# standard deviations of noise that a unit has at most, so that the dead zone has up to three
NOISE_UNITS = 1.5
LEAST = 0.1  # of the unit by the readings, below which the noise does not lower it
MOST_PAIRS = 1000  # pairs of successive frames that are compared
MEDIAN_SD = 0.6745  # median distance from the mean of a normal distribution, in standard deviations


def for_sets(members: Sequence[str]) -> list[str]:
    """The members that answer view sets; `svm` does so for others."""
    return [name for name in members if name in OF_SETS] or ["svm"]


class Representation:
    """Scaled readings of the live sensors, and the points of each member.

    Args:
        live: bool (H, W).
        centre, spread: float32 (S,) of each live sensor: mean and standard deviation of a channel;
            0 and the unit of an array.

    Attributes:
        convolutions: features of the member of this name, where there is one.
    """

    def __init__(self, live: np.ndarray, centre: np.ndarray, spread: np.ndarray):
        self.live, self.centre, self.spread, self.is_array = (
            live,
            centre,
            spread,
            features.is_array(live),
        )
        if self.is_array:
            self.blocks = features.block_weights(live)
        self.convolutions = Convolutions()

    @classmethod
    def of(cls, live: np.ndarray, sample: np.ndarray, unit: float) -> Self:
        """Measure the scale of channels on a sample of frames, counts (n, S); `unit` is that of an array."""
        centre, spread = sample.mean(axis=0, dtype=np.float64), sample.std(axis=0, dtype=np.float64)
        if features.is_array(live):
            centre, spread = 0 * centre, np.full(len(spread), unit)
        return cls(
            live, centre.astype(np.float32), np.where(spread > 0, spread, 1).astype(np.float32)
        )

    def scaled(self, counts: np.ndarray) -> np.ndarray:
        """Readings float32 (..., S) of frames, from counts (..., S) above baseline."""
        readings = np.divide(counts - self.centre, self.spread, dtype=np.float64)
        return np.clip(readings, -FARTHEST, FARTHEST).astype(np.float32)

    def of_frames(self, readings: np.ndarray) -> np.ndarray:
        """Points (n, F) of single frames' readings (n, S), for the member `kernel`."""
        return (
            features.with_blocks(features.pressed(readings), self.blocks)
            if self.is_array
            else readings
        )

    def of_sets(self, member: str, readings: np.ndarray) -> np.ndarray:
        """Points (B, F) of view sets' readings (B, k, S), for `svm` and `pooled_kernel`; no order counts."""
        return (
            self._maps(member, readings)
            if self.is_array
            else features.unordered(readings.astype(np.float64))
        )

    def of_recordings(self, member: str, readings: np.ndarray) -> np.ndarray:
        """A member's points (B, F) of whole recordings' readings (B, T, S), in the order of time."""
        if member == "convolutions":
            return np.stack([self.convolutions.features(each) for each in readings])
        if self.is_array:
            return self._maps(member, readings)
        return (features.in_time if member == "trees" else features.in_windows)(
            readings.astype(np.float64)
        )

    def _maps(self, member: str, readings: np.ndarray) -> np.ndarray:
        """Points of an array: `svm` and `trees` also read the kernels' dead zone, which may hold more than noise."""
        if member in IN_FINER:
            readings = FINER * readings
        return features.array_maps(readings, self.blocks)

    def estimator(self, member: str, *, quick: bool = False) -> Estimator:
        """The member's estimator, not fitted yet; a quick one has fewer trees or frames."""
        if member == "trees":
            return Forest(FEWEST_TREES if quick else TREES)
        if member == OF_FRAMES:
            return KernelRidge(QUICK_FRAMES if quick else MOST_FRAMES)
        vectors = SupportVectors if self.is_array else NormalisedVectors
        return {"svm": vectors, "convolutions": Ridge}.get(member, KernelRidge)()


def contact_unit(frames: np.ndarray, noise: float = np.inf) -> float:
    """The unit of a glove, in counts: one in ten readings (n, S) of frames in contact is above four units.

    It is about one count for STAG's glove, as is its noise. Where more sensors are pressed, the
    noise limits the unit. Where fewer than one in ten readings are positive, half of the positive
    ones are above four units.

    Args:
        noise: standard deviation of the readings in counts; infinite where it is unknown.
    """
    pressed = float(np.quantile(frames, 1 - PRESSED_SHARE))
    if pressed <= 0:
        positive = frames[frames > 0]
        pressed = float(np.median(positive)) if len(positive) else PRESSED_UNITS
    unit = pressed / PRESSED_UNITS
    return max(min(unit, NOISE_UNITS * noise), LEAST * unit)


def successive_noise(
    counts: "Counts", recording: np.ndarray, index: np.ndarray, live: np.ndarray
) -> float:
    """Standard deviation of the sensors' noise in counts, from the differences of successive frames.

    The median of the differences is used, which contact does not change while it changes fewer than
    half of the readings. The noise is infinite, for unknown, where it is below the steps of the
    counts, or no frames are successive.

    Args:
        counts: (n, H, W).
        recording: (n,) recording of each frame.
        index: rising indices of the frames that are compared.
        live: bool (H, W) sensors.
    """
    pairs = index[:-1][(np.diff(index) == 1) & (np.diff(recording[index]) == 0)]
    if not len(pairs):
        return np.inf
    pairs = pairs[np.unique(np.linspace(0, len(pairs) - 1, MOST_PAIRS).astype(int))]
    change = counts[pairs + 1].astype(np.float64) - counts[pairs]
    return float(np.median(np.abs(change[:, live]))) / (MEDIAN_SD * 2**0.5) or np.inf
