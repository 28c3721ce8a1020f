"""The unit of a glove's readings, so that one recipe fits every glove."""

from typing import Protocol

import numpy as np

PRESSED_SHARE = 0.1  # of the readings in contact are above PRESSED_UNITS; with STAG's glove these are four counts
PRESSED_UNITS = 4.0
NOISE_UNITS = 1.5  # standard deviations of noise that a unit has at most, so that the dead zone has up to three
LEAST = 0.1  # of the unit by the readings, below which the noise does not lower it
MOST_PAIRS = 1000  # pairs of successive frames that are compared
MEDIAN_SD = 0.6745  # median distance from the mean of a normal distribution, in standard deviations


def contact_unit(frames: np.ndarray, noise: float = np.inf) -> float:
    """The unit of a glove, in counts: one in ten readings (n, S) of frames in contact is above four units.

    It is about one count for STAG's glove, as is its noise. Where more sensors are pressed, the noise limits the unit.
    Where fewer than one in ten readings are positive, half of the positive ones are above four units.

    Args:
        noise: standard deviation of the readings in counts; infinite where it is unknown.
    """
    pressed = float(np.quantile(frames, 1 - PRESSED_SHARE))
    if pressed <= 0:
        positive = frames[frames > 0]
        pressed = float(np.median(positive)) if len(positive) else PRESSED_UNITS
    unit = pressed / PRESSED_UNITS
    return max(min(unit, NOISE_UNITS * noise), LEAST * unit)


class Rows(Protocol):
    """An array (n, ...) in memory, or memory-mapped, or computed when it is indexed."""

    def __getitem__(self, at: np.ndarray, /) -> np.ndarray: ...


def successive_noise(counts: Rows, recording: np.ndarray, index: np.ndarray, live: np.ndarray) -> float:
    """Standard deviation of the sensors' noise in counts, from the differences of successive frames.

    The median of the differences is used, which contact does not change while it changes fewer than half of the
    readings. The noise is infinite, for unknown, where it is below the steps of the counts, or no frames are
    successive.

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
