"""Scale counts to readings: in a glove's unit for an array, in standard deviations for channels."""

from typing import TYPE_CHECKING, Self

import numpy as np
from scipy.sparse import csr_array

from tactile_viewgcn.members.features import block_weights
from tactile_viewgcn.sensor_array import is_array

if TYPE_CHECKING:
    from tactile_viewgcn.tables.counts import Counts

FARTHEST = 1e15  # largest scaled reading: its square is in the range of single precision
# this share of the readings in contact is above PRESSED_UNITS, which are four counts for STAG's
# glove
PRESSED_SHARE = 0.1
PRESSED_UNITS = 4.0
# most standard deviations of noise in a unit, so that the dead zone of two units has at most three
NOISE_UNITS = 1.5
LEAST = 0.1  # the noise never lowers the unit below this share of it
MOST_PAIRS = 1000  # most pairs of successive frames that are compared
MEDIAN_SD = 0.6745  # median distance from the mean of a normal distribution, in standard deviations


class Representation:
    """The scale of the live sensors: it turns counts above baseline into readings.

    Args:
        live: bool (H, W), the S live sensors.
        centre: float32 (S,), the mean of each channel, or 0 for an array.
        spread: float32 (S,), the standard deviation of each channel, or the glove's unit for an
            array.

    Attributes:
        is_array: whether the sensors are an array. If not, they are channels.
        blocks: sparse float32 (S, B), weights of the sensors in the blocks of an array, or None for
            channels.
    """

    def __init__(self, live: np.ndarray, centre: np.ndarray, spread: np.ndarray):
        self.live = live
        self.centre = centre
        self.spread = spread
        self.is_array = is_array(live)
        self.blocks: csr_array | None = None
        if self.is_array:
            self.blocks = block_weights(live)

    @classmethod
    def of(cls, live: np.ndarray, sample: np.ndarray, unit: float) -> Self:
        """Measure the scale on a sample of frames.

        Args:
            live: bool (H, W), the S live sensors.
            sample: counts (n, S) above baseline.
            unit: the unit of an array, in counts.
        """
        centre = sample.mean(axis=0, dtype=np.float64)
        spread = sample.std(axis=0, dtype=np.float64)
        if is_array(live):
            centre = 0 * centre
            spread = np.full(len(spread), unit)
        spread = np.where(spread > 0, spread, 1)
        return cls(live, centre.astype(np.float32), spread.astype(np.float32))

    def scaled(self, counts: np.ndarray) -> np.ndarray:
        """Return the readings float32 (..., S) of counts (..., S) above baseline."""
        readings = np.divide(counts - self.centre, self.spread, dtype=np.float64)
        scaled: np.ndarray = np.clip(readings, -FARTHEST, FARTHEST).astype(np.float32)
        return scaled


def contact_unit(frames: np.ndarray, noise: float = np.inf) -> float:
    """Return the unit of a glove in counts: one in ten readings in contact is above four units.

    For STAG's glove the unit is about one count, and so is the noise. If more sensors are pressed,
    the noise limits the unit. If fewer than one in ten readings are positive, the unit is chosen so
    that half of the positive readings are above four units.

    Args:
        frames: counts (n, S) above baseline of frames in contact.
        noise: standard deviation of the readings in counts, or infinity if it is unknown.
    """
    pressed = float(np.quantile(frames, 1 - PRESSED_SHARE))
    if pressed <= 0:
        positive = frames[frames > 0]
        pressed = PRESSED_UNITS
        if len(positive):
            pressed = float(np.median(positive))
    unit = pressed / PRESSED_UNITS
    return max(min(unit, NOISE_UNITS * noise), LEAST * unit)


def successive_noise(
    counts: "Counts", recording: np.ndarray, index: np.ndarray, live: np.ndarray
) -> float:
    """Return the standard deviation of the noise in counts, from differences of successive frames.

    The noise follows from the median of the differences. Contact does not affect the median, as
    long as it changes fewer than half of the readings. The result is infinity, for unknown, if the
    noise is below the steps of the counts, or if no frames are successive.

    Args:
        counts: (n, H, W).
        recording: (n,), the recording of each frame.
        index: rising indices of the frames to compare.
        live: bool (H, W), the live sensors.
    """
    is_next_frame = np.diff(index) == 1
    is_same_recording = np.diff(recording[index]) == 0
    pairs = index[:-1][is_next_frame & is_same_recording]
    if not len(pairs):
        return np.inf
    compared = np.unique(np.linspace(0, len(pairs) - 1, MOST_PAIRS).astype(int))
    pairs = pairs[compared]
    change = counts[pairs + 1].astype(np.float64) - counts[pairs]
    noise = float(np.median(np.abs(change[:, live]))) / (MEDIAN_SD * 2**0.5)
    if noise == 0:
        return np.inf
    return noise
