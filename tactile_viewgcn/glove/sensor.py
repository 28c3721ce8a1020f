"""From pressure to counts: a piezoresistive matrix of 32 x 32 wires, read with 10 bits.

Each effect is a step of its own and is skipped where a recipe does not name it. The numbers are set by what is measured
on STAG's frames (baseline, noise, percentiles of the excess), see VERSION in `recipe.py`.
"""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.glove.hand import Hand

NO_SENSOR = 510  # counts of a cell without a sensor
MAX_COUNT = 1023  # of a 10-bit converter
SATURATION = 1.5e4  # Pa at which a sensor reads half of what a linear one would
SENSITIVITY = 9e-4  # counts per Pa of a sensor of gain 1, at low pressure
HYSTERESIS = 0.25  # share of a reading that follows its recent peak
RECOVERY = 0.6  # share of the peak that is left a frame later
CROSSTALK = (0.3, 0.3)  # shares of its row's and its column's mean that a sensor reads in addition
DRIFT = 0.95  # correlation of the common mode from frame to frame
GAIN, GAIN_OF_SESSION = 0.75, 0.3  # standard deviation of the logarithm of a sensor's gain; from session to session
DEAD, STUCK = 0.02, 0.004  # shares of the sensors: one feels no pressure, the other always reads the same
BASELINE = (515.0, 1.2)  # counts, mean and standard deviation of a session's baseline
ROW, SENSOR = 0.6, 0.3  # counts, standard deviation from it of a row and of a sensor
NOISE = (0.89, 0.09)  # counts, median of a sensor's noise, and standard deviation of its logarithm
COMMON = (0.2, 0.55)  # counts, range of a session's common mode
ROW_NOISE = 0.19  # counts
BENDING = 2.0  # counts per rad of flexion, of a typical sensor


@dataclass(frozen=True)
class Electronics:
    """The S sensors of one glove in one session.

    Attributes:
        gain: (S,) relative to SENSITIVITY; 0 for a dead sensor.
        stuck: (S,) counts above the baseline that a stuck sensor always reads; NaN for the others.
        bend: (S,) counts per rad of flexion of the joint under the sensor.
        baseline: (S,) counts; noise: (S,) counts, standard deviation.
        common: counts, standard deviation of what all sensors share; row_noise: counts, of what a row shares.
    """

    gain: np.ndarray
    stuck: np.ndarray
    bend: np.ndarray
    baseline: np.ndarray
    noise: np.ndarray
    common: float
    row_noise: float


def electronics(
    hand: Hand, glove: np.random.Generator, session: np.random.Generator, effects: frozenset[str]
) -> Electronics:  # fmt: skip
    """Draw the electronics of a glove in a session; the generator `glove` is in the same state for each session."""
    count = len(hand)
    gain = np.exp(glove.normal(0, GAIN, count) - GAIN**2 / 2)
    defect = glove.random(count)
    bend = BENDING * glove.normal(0, 1, count) ** 2
    noise = np.exp(glove.normal(np.log(NOISE[0]), NOISE[1], count))
    gain = gain * np.exp(session.normal(0, GAIN_OF_SESSION, count))
    baseline = session.normal(*BASELINE) + session.normal(0, ROW, 32)[hand.row]
    baseline = baseline + session.normal(0, SENSOR, count)
    common = session.uniform(*COMMON)
    stuck = np.full(count, np.nan)
    if "defects" in effects:
        gain[defect < DEAD] = 0
        is_stuck = defect > 1 - STUCK
        stuck[is_stuck] = 5 * glove.random(count)[is_stuck]
    return Electronics(gain, stuck, bend, baseline, noise, common, ROW_NOISE)


class Sensors:
    """Reads B recordings block by block; hysteresis and common mode carry over from one block to the next.

    Args:
        hand: where the sensors are.
        kits: B electronics, one a recording.
        rngs: B generators of the noise.
        effects: those of `recipe.READING` to simulate.
    """

    def __init__(self, hand: Hand, kits: list[Electronics], rngs: list[np.random.Generator], effects: frozenset[str]):
        self.hand, self.effects = hand, effects
        self.rngs = [(rng, *rng.spawn(1)) for rng in rngs]  # of the sensors' noise, and of the common mode
        self.gain, self.stuck, self.bend, self.baseline, self.noise = (
            np.stack([getattr(kit, name) for kit in kits]) for name in ("gain", "stuck", "bend", "baseline", "noise")
        )
        self.common, self.row_noise = ([getattr(kit, name) for kit in kits] for name in ("common", "row_noise"))
        self.peak = np.zeros_like(self.gain)
        self.drift = np.zeros(len(kits))

    def read(self, pressure: np.ndarray, flexion: np.ndarray) -> np.ndarray:
        """Counts (B, T, 32, 32) int16 for pressure (B, T, S) Pa and flexion (B, T, S) rad."""
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
        counts = self.baseline[:, None] + excess
        if effects & {"noise", "common_mode"}:
            self._add_noise(counts)
        return self.hand.frame(np.clip(np.rint(counts), 0, MAX_COUNT).astype(np.int16), NO_SENSOR)

    def _add_noise(self, counts: np.ndarray) -> None:
        """Add noise and common mode to counts (B, T, S), in place; drawn by frame, so that blocks may differ."""
        _, frames, sensors = counts.shape
        for b, (sensor_rng, common_rng) in enumerate(self.rngs):
            if "noise" in self.effects:
                draws = sensor_rng.standard_normal((frames, sensors + 32))
                of_sensors, of_rows = draws[:, :sensors], draws[:, sensors:]
                counts[b] += self.noise[b] * of_sensors + self.row_noise[b] * of_rows[:, self.hand.row]
            if "common_mode" in self.effects:
                for t, draw in enumerate(common_rng.standard_normal((frames,))):
                    self.drift[b] = DRIFT * self.drift[b] + np.sqrt(1 - DRIFT**2) * self.common[b] * draw
                    counts[b, t] += self.drift[b]

    def _crosstalk(self, excess: np.ndarray) -> np.ndarray:
        """Leakage of a passive matrix: adds to each sensor of (B, T, S) a share of its row's and column's mean."""
        leaked = excess.copy()
        for share, index in zip(CROSSTALK, (self.hand.row, self.hand.column), strict=True):
            sums = np.zeros((*excess.shape[:-1], 32))
            for line in range(32):
                sums[..., line] = excess[..., index == line].sum(axis=-1)
            leaked += share * (sums / np.maximum(np.bincount(index, minlength=32), 1))[..., index]
        return leaked
