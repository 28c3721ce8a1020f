"""The moments of a session: the mean of its open hand, its noise, and its drift.

Noise is how much an open hand's readings vary within a recording. Drift is how much the means of
open hands differ between recordings. A recording of the empty hand is an open hand from its first
frame to its last.
"""

from typing import NamedTuple

import numpy as np

from tactile_viewgcn.frames.drift import drift_between
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings

MIN_FRAMES = 5  # fewest frames for a mean
ROUNDING_SD = 12**-0.5  # standard deviation of rounding to whole steps, in steps
# a frame this many standard deviations from the mean is an outlier: even the empty hand bumps into
# objects
OUTLIER_SD = 3.0
MAX_PASSES = 5  # most passes over the frames that leave out outliers
MEAN_FRAMES = 10_000  # most frames for a mean, which is then exact to a hundredth of the noise
NOISE_FRAMES = 2000  # most frames for the noise
LONG_FRAMES = 32  # fewest frames of a recording of the empty hand for its own noise
# if a sensor reads the smallest count in more than this share of the frames, its noise is cut off
CUT_OFF = 0.25
# standard deviation of a normal distribution that is cut off at its mean, as a share of the
# standard deviation of the whole distribution
HALF_SD = 0.584
# least noise in steps if it is measured on differences: a reading that changes by one step is then
# below weak pressure, see `drift.WEAK`
LEAST_STEPS = 0.35


class Moments(NamedTuple):
    """Mean, noise and drift of the S live sensors of a session, in counts.

    Attributes:
        mean: (S,) of the open hand; None if it is not known.
        noise: (S,) standard deviation of an open hand about its own mean.
        session_noise: (S,) standard deviation of all open hands about `mean`.
        drift: standard deviation of the means of open hands, that of the median sensor or more; see
            `frames/drift.py`.
    """

    mean: np.ndarray | None
    noise: np.ndarray
    session_noise: np.ndarray
    drift: float = 0.0

    @property
    def drifted_noise(self) -> np.ndarray:
        """Return the standard deviation (S,) of a further open hand about `mean`.

        A few open hands can lie close together by chance in some sensors, so each sensor has
        `drift` at least.
        """
        least = np.hypot(self.noise, self.drift)
        drifted: np.ndarray = np.maximum(self.session_noise, least)
        return drifted

    def with_drift(self, drift: float) -> "Moments":
        """Return moments that have this drift at least, also in the session's noise.

        A single recording of the empty hand shows no drift.
        """
        session_noise = np.maximum(self.session_noise, np.hypot(self.noise, drift))
        return self._replace(session_noise=session_noise, drift=max(self.drift, drift))


def session_moments(recordings: Recordings, trained: list[Moments] | None = None) -> list[Moments]:
    """Return the mean of the empty hand and the noise of the live sensors in each session.

    If a session has too few frames of the empty hand, its moments come from `trained`. Without
    `trained`, the mean is None, and the noise is measured on differences of successive frames, see
    `noise_of_changes`.

    Args:
        recordings: T frames.
        trained: the moments that the training set has for each of these sessions.
    """
    session = recordings.columns["session"]
    moments = []
    for number in range(len(recordings.sessions)):
        measured = _moments(recordings, np.flatnonzero(session == number))
        if measured.mean is None and trained:
            measured = trained[number]
        moments.append(measured)
    return moments


def _moments(recordings: Recordings, index: np.ndarray) -> Moments:
    """Return the moments of one session, whose frames are `index` (n,)."""
    counts = recordings.live_counts()
    if len(index) < 2:
        unknown = np.ones(counts.shape[1])
        return Moments(None, unknown, unknown)
    empty = index[recordings.empty_hand[index]]
    if len(empty) >= MIN_FRAMES:
        # no other recording of the session counts, so that none changes the answer to another
        visible = visible_noise(counts[evenly(empty, NOISE_FRAMES)])
        sample = evenly(empty, MEAN_FRAMES)
        recording = recordings.columns["recording"][sample]
        return _empty_hand_moments(counts[sample], recording, visible)
    visible = visible_noise(counts[evenly(index, NOISE_FRAMES)])
    sample = evenly(np.arange(len(index) - 1), NOISE_FRAMES)
    noise = noise_of_changes(counts[index[sample]], counts[index[sample + 1]], visible)
    return Moments(None, noise, noise)


def noise_of_changes(earlier: np.ndarray, later: np.ndarray, visible: float) -> np.ndarray:
    """Return the standard deviation (S,) of the noise, from differences of successive frames.

    Drift adds little to these differences, and contact changes in few of them. Noise that a filter
    has smoothed over several frames hides in them.

    Args:
        earlier: (n, S) counts.
        later: (n, S) counts of the frames after these.
        visible: see `visible_noise`.
    """
    step = _step(earlier)
    _, of_changes = trimmed_moments(later.astype(np.float64) - earlier, visible, step=step)
    noise: np.ndarray = np.maximum(of_changes / np.sqrt(2), LEAST_STEPS * step)
    return noise


def _empty_hand_moments(counts: np.ndarray, recording: np.ndarray, visible: float) -> Moments:
    """Return the moments of a session's empty hand.

    The noise and the drift are measured if two recordings or more have enough frames for it. Slow
    changes hide in a shorter recording. Otherwise the noise is the session's.

    Args:
        counts: (n, S) of the empty hand.
        recording: (n,) number of each frame's recording.
        visible: see `visible_noise`.
    """
    mean, session_noise = trimmed_moments(counts, visible)
    numbers, frames = np.unique(recording, return_counts=True)
    long = numbers[frames >= LONG_FRAMES]
    if len(long) < 2:
        return Moments(mean, session_noise, session_noise)
    # the middle of a recording's readings does not change if the hand bumps into an object
    middles = np.stack([np.median(counts[recording == number], axis=0) for number in long])
    of_long = np.isin(recording, long)
    deviations = counts[of_long] - middles[np.searchsorted(long, recording[of_long])]
    _, noise = trimmed_moments(deviations, visible, step=_step(counts))
    return Moments(mean, noise.astype(session_noise.dtype), session_noise, drift_between(middles))


def trimmed_moments(
    counts: np.ndarray, visible: float = 1.0, *, step: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean and the standard deviation (...) of each sensor, without outliers.

    Readings further than three standard deviations from the mean are left out. A median would not
    do: it is no finer than whole counts, and the median of the signal is one count. Differences
    from the first frame are summed, so that an offset costs no digits.

    Args:
        counts: (T, ...).
        visible: see `visible_noise`. The standard deviation is divided by it. It never becomes
            smaller than the standard deviation of rounding.
        step: the step that counts are rounded to; None finds it, see `_step`. It cannot be found in
            differences of counts, so it has to be given for them.
    """
    dtype = np.result_type(counts.dtype, np.float32)
    first = counts[0].astype(np.float64)
    if step is None:
        step = _step(counts)
    rounding = ROUNDING_SD * step
    values = counts - first
    inside = np.ones(values.shape, dtype=bool)
    for _ in range(MAX_PASSES):
        mean = values.mean(axis=0, where=inside)
        spread = values.std(axis=0, where=inside)
        tighter = np.abs(values - mean) <= OUTLIER_SD * np.maximum(spread, rounding)
        if (tighter == inside).all():
            break
        inside = tighter
    return (first + mean).astype(dtype), np.maximum(spread / visible, rounding).astype(dtype)


def visible_noise(counts: np.ndarray) -> float:
    """Return the share of the noise's standard deviation that counts (n, S) of live sensors show.

    The share is 0.584 if most sensors often read the smallest of all counts, because half of their
    noise is cut off there. Otherwise it is 1.
    """
    is_smallest = counts == counts.min()
    if np.median(is_smallest.mean(axis=0)) > CUT_OFF:
        return HALF_SD
    return 1.0


def _step(counts: np.ndarray) -> float:
    """Return the step that counts (T, ...) are rounded to.

    The step of integers is 1. The step of real numbers is the smallest gap between two of them,
    where gaps below eight units of the last digit are rounding errors. If all counts are equal, the
    step is one unit of the last digit.
    """
    if counts.dtype.kind in "iu":
        return 1.0
    last_digit = float(np.spacing(np.abs(counts).max()))
    gaps = np.diff(np.unique(counts).astype(np.float64))
    return float(min(gaps[gaps > 8 * last_digit], default=last_digit))
