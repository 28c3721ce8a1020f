"""From pressure to counts: a piezoresistive matrix of 32 x 32 wires, read with 10 bits.

Each effect is a step of its own, left out where a scene does not name it. The numbers are set by what is measured on
STAG's frames (rest, noise, percentiles of the excess), see VERSION in `simulation.py`.
"""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.glove.hand import Hand

NOWHERE = 510  # counts of a cell without a sensor
FULL = 1023  # counts of a 10-bit converter
SATURATION = 1.5e4  # Pa at which the response has fallen to half
SENSITIVITY = 9e-4  # counts per Pa of a usual sensor, at little pressure
HYSTERESIS, RECOVERY = 0.25, 0.6  # share of a reading that lags behind its own peak; what is left of it a frame later
CROSSTALK = (0.3, 0.3)  # share of its row's and its column's mean that a sensor reads besides its own
DRIFT = 0.95  # correlation of the common mode from frame to frame
BENDING = 2.0  # counts that the stretched glove adds to a usual sensor for a radian of flexion


@dataclass(frozen=True)
class Electronics:
    """How one glove's sensors differ, and one session's rest.

    Attributes:
        gain: (S,) relative to SENSITIVITY; a dead sensor has 0.
        stuck: (S,) counts above rest of a stuck sensor, NaN of the others.
        bend: (S,) counts per radian of the sensor's own joint.
        rest: (S,) counts; noise: (S,) counts, standard deviation.
        common: counts, standard deviation of what all sensors share; row_noise: of what a row shares.
    """

    gain: np.ndarray
    stuck: np.ndarray
    bend: np.ndarray
    rest: np.ndarray
    noise: np.ndarray
    common: float
    row_noise: float


@dataclass(frozen=True)
class Spread:
    """How gloves and sessions vary.

    Attributes:
        gain, gain_session: standard deviation of a sensor's gain's logarithm.
        dead, stuck: share of the sensors; a dead one feels no pressure, a stuck one always reads the same excess.
        base: counts, mean and standard deviation of a session's rest; row, sensor: standard deviations on top.
        noise: counts, median of a sensor's noise and standard deviation of its logarithm.
        common: counts, from and to which a session's common mode varies; row_noise: counts.
    """

    gain: float = 0.75
    gain_session: float = 0.3
    dead: float = 0.02
    stuck: float = 0.004
    base: tuple[float, float] = (515.0, 1.2)
    row: float = 0.6
    sensor: float = 0.3
    noise: tuple[float, float] = (0.89, 0.09)
    common: tuple[float, float] = (0.2, 0.55)
    row_noise: float = 0.19


def electronics(
    hand: Hand, glove: np.random.Generator, session: np.random.Generator, effects: frozenset[str], spread: Spread
) -> Electronics:
    """One session's electronics of a glove; the glove's generator must come fresh each time."""
    count = len(hand)
    gain = np.exp(glove.normal(0, spread.gain, count) - spread.gain**2 / 2)
    broken = glove.random(count)
    bend = BENDING * glove.normal(0, 1, count) ** 2
    noise = np.exp(glove.normal(np.log(spread.noise[0]), spread.noise[1], count))
    gain = gain * np.exp(session.normal(0, spread.gain_session, count))
    rest = session.normal(*spread.base) + session.normal(0, spread.row, 32)[hand.row]
    rest = rest + session.normal(0, spread.sensor, count)
    common = session.uniform(*spread.common)
    stuck = np.full(count, np.nan)
    if "defects" in effects:
        gain[broken < spread.dead] = 0
        at = broken > 1 - spread.stuck
        stuck[at] = 5 * glove.random(count)[at]
    return Electronics(gain, stuck, bend, rest, noise, common, spread.row_noise)


class Sensors:
    """The reading of B recordings, frame after frame; the only thing it remembers is the hysteresis."""

    def __init__(self, hand: Hand, kits: list[Electronics], rngs: list[np.random.Generator], effects: frozenset[str]):
        self.hand, self.effects = hand, effects
        self.rngs = [(rng, *rng.spawn(1)) for rng in rngs]  # of the sensors' noise, and of the common mode
        self.gain, self.stuck, self.bend, self.rest, self.noise = (
            np.stack([getattr(kit, name) for kit in kits]) for name in ("gain", "stuck", "bend", "rest", "noise")
        )
        self.common, self.row_noise = ([getattr(kit, name) for kit in kits] for name in ("common", "row_noise"))
        self.peak = np.zeros_like(self.gain)
        self.drift = np.zeros(len(kits))
        self.row_size, self.column_size = np.bincount(hand.row, minlength=32), np.bincount(hand.column, minlength=32)

    def read(self, pressure: np.ndarray, flexion: np.ndarray) -> np.ndarray:
        """Counts (B, T, 32, 32), int16, of pressures (B, T, S) in Pa and flexion (B, T, S) in rad."""
        effects = self.effects
        excess = SENSITIVITY * self.gain[:, None] * pressure
        if "saturation" in effects:
            excess /= 1 + pressure / SATURATION
        if "bending" in effects:
            excess += self.bend[:, None] * flexion
        if "hysteresis" in effects:
            for t in range(excess.shape[1]):
                self.peak = np.maximum(excess[:, t], RECOVERY * self.peak)
                excess[:, t] += HYSTERESIS * (self.peak - excess[:, t])
        if "crosstalk" in effects:
            excess = self._crosstalk(excess)
        if "defects" in effects:
            excess = np.where(np.isnan(self.stuck)[:, None], excess, self.stuck[:, None])
        counts = self.rest[:, None] + excess
        _, frames, sensors = counts.shape
        for b, (own, shared) in enumerate(self.rngs):
            if "noise" in effects:
                draws = own.standard_normal(
                    (frames, sensors + 32)
                )  # frame by frame, so that blocks may have any length
                counts[b] += (
                    self.noise[b] * draws[:, :sensors] + self.row_noise[b] * draws[:, sensors:][:, self.hand.row]
                )
            if "common_mode" in effects:
                for t, kick in enumerate(shared.standard_normal(frames)):
                    self.drift[b] = DRIFT * self.drift[b] + np.sqrt(1 - DRIFT**2) * self.common[b] * kick
                    counts[b, t] += self.drift[b]
        return self.hand.frame(np.clip(np.rint(counts), 0, FULL).astype(np.int16), NOWHERE)

    def _crosstalk(self, excess: np.ndarray) -> np.ndarray:
        """What a passive matrix leaks: every sensor reads a share of its row's and its column's mean."""
        out = excess.copy()
        for share, index, size in zip(
            CROSSTALK, (self.hand.row, self.hand.column), (self.row_size, self.column_size), strict=True
        ):
            sums = np.zeros((*excess.shape[:-1], 32))
            for line in range(32):
                sums[..., line] = excess[..., index == line].sum(axis=-1)
            out += share * (sums / np.maximum(size, 1))[..., index]
        return out
