"""From pressure to counts: a piezoresistive matrix of 32 x 32 wires, read with 10 bits.

Each effect is a separate step, which is skipped if the recipe does not name it. The constants are
set against STAG's frames: their baseline, their noise, and percentiles of the readings above the
baseline. See VERSION in `simulation.py`.
"""

import numpy as np

from tactile_viewgcn.glove.hand import SHAPE, Hands
from tactile_viewgcn.randomness import stream

NO_SENSOR = 510  # counts of a cell without a sensor
MAX_COUNT = 1023  # largest count of a 10-bit converter
SATURATION = 1.5e4  # Pa at which a sensor reads half of a linear sensor's counts
SENSITIVITY = 1.4e-3  # counts per Pa of a sensor of gain 1, at low pressure
HYSTERESIS = 0.25  # share of the way to its recent peak by which a reading is raised
RECOVERY = 0.6  # share of the peak that remains a frame later
# shares of the mean of its row, and of its column, that are added to a sensor's reading
CROSSTALK = (0.3, 0.3)
DRIFT = 0.95  # correlation of the common mode from frame to frame
GAIN = 0.75  # standard deviation of the logarithm of a sensor's gain
GAIN_OF_SESSION = 0.1  # standard deviation of the same logarithm from session to session
DEAD = 0.02  # share of sensors that read no pressure
STUCK = 0.004  # share of sensors that always read the same count
MOST_STUCK = 5  # largest number of counts above the baseline that a stuck sensor reads
BASELINE = (515.0, 1.2)  # counts, mean and standard deviation of a session's baseline
ROW = 0.6  # counts, standard deviation of a row from the session's baseline
SENSOR = 0.3  # counts, standard deviation of a sensor from the baseline of its row
NOISE = (0.89, 0.09)  # counts, median of a sensor's noise, and standard deviation of its logarithm
COMMON = (0.2, 0.55)  # counts, range of a session's common mode
ROW_NOISE = 0.19  # counts, standard deviation of the noise that a row shares
BENDING = 1.2  # counts per rad of flexion that a typical sensor reads


class Sensors:
    """The electronics of B recordings, which are read block by block.

    Hysteresis and common mode carry over from one block to the next.

    Args:
        hands: hands with the cells of the S sensors.
        seed: seed of the glove and its sessions.
        sessions: session of each of the B recordings. Gain, baseline and common mode differ between
            sessions.
        rngs: B generators, which draw the noise.
        effects: the effects of `simulation.EFFECTS` that are simulated.

    Attributes:
        gain: (B, S) gain relative to SENSITIVITY; 0 for a dead sensor.
        stuck: (B, S) counts above the baseline that a stuck sensor always reads; NaN for all
            others.
        bend: (B, S) counts per rad of flexion of the joint under the sensor.
        baseline: (B, S) counts without pressure.
        noise: (B, S) counts, standard deviation of each sensor's noise.
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
        self.hands = hands
        self.effects = effects
        # one generator for the sensors' noise of each recording, and one for its common mode
        self.rngs = [(rng, *rng.spawn(1)) for rng in rngs]
        electronics = [
            self._electronics(stream(seed, "glove"), stream(seed, "glove session", session))
            for session in sessions
        ]
        gain, stuck, bend, baseline, noise, common = map(np.stack, zip(*electronics, strict=True))
        self.gain = gain
        self.stuck = stuck
        self.bend = bend
        self.baseline = baseline
        self.noise = noise
        self.common = common
        self.peak = np.zeros_like(gain)
        self.drift = np.zeros(len(sessions))

    def _electronics(
        self, glove: np.random.Generator, session: np.random.Generator
    ) -> tuple[np.ndarray | float, ...]:
        """Return gain, stuck, bend, baseline and noise (S,), and the common mode.

        The generators draw them for a glove in one of its sessions.
        """
        count = len(self.hands.row)
        gain = np.exp(glove.normal(0, GAIN, count) - GAIN**2 / 2)
        defect = glove.random(count)
        bend = BENDING * glove.normal(0, 1, count) ** 2
        noise = np.exp(glove.normal(np.log(NOISE[0]), NOISE[1], count))
        gain = gain * np.exp(session.normal(0, GAIN_OF_SESSION, count))
        baseline = session.normal(*BASELINE) + session.normal(0, ROW, SHAPE[0])[self.hands.row]
        baseline = baseline + session.normal(0, SENSOR, count)
        common = session.uniform(*COMMON)
        stuck = np.full(count, np.nan)
        if "defects" in self.effects:
            gain[defect < DEAD] = 0
            is_stuck = defect > 1 - STUCK
            stuck[is_stuck] = MOST_STUCK * glove.random(count)[is_stuck]
        return gain, stuck, bend, baseline, noise, common

    def read(self, pressure: np.ndarray, flexion: np.ndarray) -> np.ndarray:
        """Return the counts int16 (B, T, 32, 32) of a block.

        Args:
            pressure: (B, T, S) Pa, pressure on the sensors.
            flexion: (B, T, S) rad, flexion under the sensors.
        """
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
        """Add noise and common mode to counts (B, T, S), in place.

        They are added frame by frame, so the result does not depend on the length of a block.
        """
        _, frames, sensors = counts.shape
        rows = SHAPE[0]
        for b, (sensor_rng, common_rng) in enumerate(self.rngs):
            if "noise" in self.effects:
                draws = sensor_rng.standard_normal((frames, sensors + rows))
                of_sensors = draws[:, :sensors]
                of_rows = draws[:, sensors:]
                counts[b] += self.noise[b] * of_sensors + ROW_NOISE * of_rows[:, self.hands.row]
            if "common_mode" in self.effects:
                for t, draw in enumerate(common_rng.standard_normal((frames,))):
                    step = np.sqrt(1 - DRIFT**2) * self.common[b] * draw
                    self.drift[b] = DRIFT * self.drift[b] + step
                    counts[b, t] += self.drift[b]

    def _crosstalk(self, excess: np.ndarray) -> np.ndarray:
        """Return readings (B, T, S) with the leakage of a passive matrix.

        Each sensor reads a share of the mean of its row, and of its column, in addition.
        """
        leaked = excess.copy()
        for share, line_of_sensor, lines in (
            (CROSSTALK[0], self.hands.row, SHAPE[0]),
            (CROSSTALK[1], self.hands.column, SHAPE[1]),
        ):
            sums = np.zeros((*excess.shape[:-1], lines))
            for line in range(lines):
                sums[..., line] = excess[..., line_of_sensor == line].sum(axis=-1)
            sensors = np.bincount(line_of_sensor, minlength=lines)
            means = sums / np.maximum(sensors, 1)
            leaked += share * means[..., line_of_sensor]
        return leaked
