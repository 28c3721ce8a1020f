"""From pressure to counts: a piezoresistive matrix of 32 x 32 wires, read with 10 bits.

Each effect is a separate step, skipped where a recipe does not name it. The constants are set
against STAG's frames (baseline, noise, percentiles of the excess), see VERSION in `simulation.py`.
"""

import numpy as np

from tactile_viewgcn.glove.hand import SHAPE, Hands
from tactile_viewgcn.randomness import stream

NO_SENSOR = 510  # counts of a cell without a sensor
MAX_COUNT = 1023  # of a 10-bit converter
SATURATION = 1.5e4  # Pa at which a sensor reads half of a linear sensor's counts
SENSITIVITY = 1.4e-3  # counts per Pa of a sensor of gain 1, at low pressure
HYSTERESIS = 0.25  # share of a reading that follows its recent peak
RECOVERY = 0.6  # share of the peak that is left a frame later
# shares of its row's and its column's mean that a sensor adds to its reading
CROSSTALK = (0.3, 0.3)
DRIFT = 0.95  # correlation of the common mode from frame to frame
# standard deviation of the logarithm of a sensor's gain; from session to session
GAIN, GAIN_OF_SESSION = 0.75, 0.1
# shares of sensors that read no pressure, and of those that always read the same
DEAD, STUCK = 0.02, 0.004
BASELINE = (515.0, 1.2)  # counts, mean and standard deviation of a session's baseline
ROW, SENSOR = 0.6, 0.3  # counts, standard deviation from it of a row and of a sensor
NOISE = (0.89, 0.09)  # counts, median of a sensor's noise, and standard deviation of its logarithm
COMMON = (0.2, 0.55)  # counts, range of a session's common mode
ROW_NOISE = 0.19  # counts
BENDING = 1.2  # counts per rad of flexion, of a typical sensor


class Sensors:
    """Reads B recordings block by block; hysteresis and common mode carry over from one block to the next.

    Args:
        hands: with the cells of the S sensors.
        seed: seed of the glove and its sessions.
        sessions: (B,) session of each recording; gain, baseline and common mode differ between
            sessions.
        rngs: B generators of the noise.
        effects: those of `simulation.EFFECTS` that are simulated.

    Attributes:
        gain: (B, S) relative to SENSITIVITY; 0 for a dead sensor.
        stuck: (B, S) counts above the baseline that a stuck sensor always reads; NaN for all
            others.
        bend: (B, S) counts per rad of flexion of the joint under the sensor.
        baseline: (B, S) counts; noise: (B, S) counts, standard deviation.
        common: (B,) counts, standard deviation of the noise that all sensors share.
    """

    def __init__(
        self,
        hands: Hands,
        seed: int,
        sessions: list[int],
        rngs: list[np.random.Generator],
        effects: frozenset[str],
    ):
        self.hands, self.effects = hands, effects
        # for the sensors' noise, and for the common mode
        self.rngs = [(rng, *rng.spawn(1)) for rng in rngs]
        electronics = [
            self._electronics(stream(seed, "glove"), stream(seed, "glove session", n))
            for n in sessions
        ]
        self.gain, self.stuck, self.bend, self.baseline, self.noise, self.common = (
            np.stack(values) for values in zip(*electronics, strict=True)
        )
        self.peak, self.drift = np.zeros_like(self.gain), np.zeros(len(sessions))

    def _electronics(
        self, glove: np.random.Generator, session: np.random.Generator
    ) -> tuple[np.ndarray | float, ...]:
        """Gain, stuck, bend, baseline, noise (S,) and common mode, drawn for a glove in a session."""
        count = len(self.hands.row)
        gain = np.exp(glove.normal(0, GAIN, count) - GAIN**2 / 2)
        defect = glove.random(count)
        bend = BENDING * glove.normal(0, 1, count) ** 2
        noise = np.exp(glove.normal(np.log(NOISE[0]), NOISE[1], count))
        gain = gain * np.exp(session.normal(0, GAIN_OF_SESSION, count))
        baseline = session.normal(*BASELINE) + session.normal(0, ROW, 32)[self.hands.row]
        baseline = baseline + session.normal(0, SENSOR, count)
        common = session.uniform(*COMMON)
        stuck = np.full(count, np.nan)
        if "defects" in self.effects:
            gain[defect < DEAD] = 0
            is_stuck = defect > 1 - STUCK
            stuck[is_stuck] = 5 * glove.random(count)[is_stuck]
        return gain, stuck, bend, baseline, noise, common

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
        self._add_noise(counts)
        frames = np.full((*counts.shape[:-1], *SHAPE), NO_SENSOR, np.int16)
        frames[..., self.hands.row, self.hands.column] = np.clip(np.rint(counts), 0, MAX_COUNT)
        return frames

    def _add_noise(self, counts: np.ndarray) -> None:
        """Add noise and common mode to counts (B, T, S), in place, frame by frame: the length of a block is free."""
        _, frames, sensors = counts.shape
        for b, (sensor_rng, common_rng) in enumerate(self.rngs):
            if "noise" in self.effects:
                draws = sensor_rng.standard_normal((frames, sensors + 32))
                of_sensors, of_rows = draws[:, :sensors], draws[:, sensors:]
                counts[b] += self.noise[b] * of_sensors + ROW_NOISE * of_rows[:, self.hands.row]
            if "common_mode" in self.effects:
                for t, draw in enumerate(common_rng.standard_normal((frames,))):
                    self.drift[b] = (
                        DRIFT * self.drift[b] + np.sqrt(1 - DRIFT**2) * self.common[b] * draw
                    )
                    counts[b, t] += self.drift[b]

    def _crosstalk(self, excess: np.ndarray) -> np.ndarray:
        """Leakage of a passive matrix: adds to each sensor of (B, T, S) a share of its row's and column's mean."""
        leaked = excess.copy()
        for share, index in zip(CROSSTALK, (self.hands.row, self.hands.column), strict=True):
            sums = np.zeros((*excess.shape[:-1], 32))
            for line in range(32):
                sums[..., line] = excess[..., index == line].sum(axis=-1)
            leaked += share * (sums / np.maximum(np.bincount(index, minlength=32), 1))[..., index]
        return leaked
