"""Which sensors vary, and which of these are clocks: by a clock alone recordings can be told from earlier ones."""

from collections.abc import Callable, Sequence

import numpy as np

from tactile_viewgcn.messages import Note, several
from tactile_viewgcn.readers.source import listed

FEWEST, EVEN = 20, 0.9  # steps that show a clock; share of them within half the median
MOST = 4  # with as many sensors that rise they are pressed ever harder


class LiveSensors:
    """The range of each sensor (H, W), and whether it rises evenly from frame to frame in every recording."""

    def __init__(self, shape: tuple[int, ...]):
        self._low, self._high = np.full(shape, np.inf), np.full(shape, -np.inf)
        self._rising, self._even, self._steps = np.ones(shape, dtype=bool), np.zeros(shape, dtype=np.int64), 0

    def add(self, pressure: np.ndarray, recording: np.ndarray) -> None:
        """Take a block of consecutive frames (n, H, W) into account, with the number (n,) of each one's recording."""
        np.minimum(self._low, pressure.min(axis=0), out=self._low)
        np.maximum(self._high, pressure.max(axis=0), out=self._high)
        within = recording[1:] == recording[:-1]
        self._rising &= (pressure[1:] > pressure[:-1])[within].all(axis=0)
        rising = np.flatnonzero(self._rising)
        readings = pressure.reshape(len(pressure), -1)[:, rising].astype(np.float64)
        steps = np.diff(readings, axis=0)[within]
        self._steps += len(steps)
        if steps.size:
            middle = np.median(steps, axis=0)
            self._even.flat[rising] += (np.abs(steps - middle) <= middle / 2).sum(axis=0)

    @property
    def spread(self) -> float:
        """Largest range of a sensor."""
        return float((self._high - self._low).max())

    def live(self, readings: Callable[[int, int], np.ndarray], recording: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bool (H, W): the sensors that vary, without clocks; and the clocks, which only several recordings show.

        A clock rises evenly, and in all recordings it begins alike, or each one reads later times than those before.

        Args:
            readings: function from row and column of a sensor to its readings (T,) in all frames.
            recording: (T,) number of each frame's recording.
        """
        varying, clocks = self._low < self._high, self._rising & (self._even > EVEN * self._steps)
        recorded = np.unique(recording)
        if self._steps < FEWEST or clocks.sum() >= min(MOST, varying.sum()) or len(recorded) < 2:
            clocks[:] = False
        for row, column in np.argwhere(clocks).tolist():
            times = readings(row, column).astype(np.float64)
            first, last = np.full(recording.max() + 1, np.inf), np.full(recording.max() + 1, -np.inf)
            np.minimum.at(first, recording, times)
            np.maximum.at(last, recording, times)
            order = np.argsort(first)[: len(recorded)]
            begin_alike = np.ptp(first[order]) <= np.median(np.diff(times))
            clocks[row, column] = begin_alike or (first[order][1:] > last[order][:-1]).all()
        return varying & ~clocks, clocks


def sensor_names(sensors: np.ndarray, channel_names: Sequence[str] = ()) -> list[str]:
    """The channel's name, or row and column from 1, of each of some sensors, bool (H, W)."""
    names = list(channel_names) or [f"row {row + 1}, column {column + 1}" for row, column in np.ndindex(sensors.shape)]
    return [names[at] or f"column {at + 1}" for at in np.flatnonzero(sensors).tolist()]


def clock_notes(clocks: list[str]) -> list[Note]:
    """A warning that names the clocks, if there are any."""
    what = f"{several(len(clocks), 'sensor')} left out: rising like a clock in every recording: {listed(clocks, '; ')}"
    return [Note(what, "warning", "clock")] if clocks else []
