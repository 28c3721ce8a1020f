"""Zero, sign and unit of the channels: one for all, or each its own where they are of unlike kind."""

import numpy as np

from tactile_viewgcn.frames.baseline import MIN_FRAMES, evenly
from tactile_viewgcn.tables.counts import Counts
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

SAMPLE = 2000  # frames, or pairs of successive frames, that are compared
ENDS = (0.1, 50, 99.9)  # percentiles of a channel's readings; its range is from the first to the last
STEPS = (10, 50)  # percentiles of its changes from frame to frame, but for zeros: the finest ones, and its noise
NOISY = 8.0  # times its noise; a channel of a smaller range shows nothing else
LEAST = 20.0  # times its noise: the smallest range that counts as full scale, so that noise alone stays small
ROUNDING = 1e-6  # of a channel's readings
OUTLIERS = 0.01  # share of the channels at either end that may be faulty
UNLIKE = 10.0  # ratio of ranges, and of finest changes, of unlike channels
FAR, FALLS = 5.0, 0.8  # times the noise from a recording's first frames; share of such readings that lies below them
FULL_SCALE = 100.0  # per cent


def measure_units(recordings: Recordings, asked: str) -> tuple[str, np.ndarray | None, str]:
    """The value of `preprocess.unit`, zero and gain of each channel, and the reason, measured on training recordings.

    Channels of one kind have alike finest changes, which are those of noise or of counts, however far each is pressed.
    Those of unlike kind differ tenfold in them and in their ranges, or are further apart than any range. With
    `each` readings become per cent of the channel's range. With `one` they stay as they are, but are turned round where
    they fall when a sensor is pressed. Frames that stand alone show no changes and count as of one kind.

    Returns:
        `one` or `each`; (2, H, W), by which a reading r becomes (r - zero) * gain, or None: it stays r; a text.
    """
    counts, recorded = recordings.live_counts(), frames_by_recording(recordings)
    sample = counts[evenly(np.arange(len(counts)), SAMPLE)]
    low, middle, high = np.percentile(sample, ENDS, axis=0, method="nearest").astype(np.float64)
    span, (finest, noise) = high - low, _changes(counts, recorded)
    active = (span > NOISY * noise) & (span > ROUNDING * np.abs([low, high]).max(axis=0))
    falls, all_fall, unit, reason = *_falling(counts, recorded, noise, active), "one", "all sensors are of one kind"
    if active.any():
        (least, most), (fine, coarse) = _ends(span[active]), _ends(finest[active])
        bottom, top = _ends(high[active])[0], _ends(low[active])[1]  # of two channels that are apart
        if most > UNLIKE * least and coarse > UNLIKE * fine:
            unit, reason = "each", f"channels are of unlike kind: ranges from {least:.3g} to {most:.3g}"
        elif top - bottom > most:
            unit, reason = "each", f"channels are apart: one reads {bottom:.3g} at most, one {top:.3g} at least"
    if asked != "auto":
        unit = asked
    zero, gain = np.zeros(recordings.shape), np.ones(recordings.shape)
    if unit == "each":
        size = np.maximum(span, LEAST * np.where(np.isfinite(noise), noise, 0))
        zero[recordings.live] = np.where(falls, high, low)
        gain[recordings.live] = np.where(falls, -FULL_SCALE, FULL_SCALE) / np.where(size > 0, size, FULL_SCALE)
    elif all_fall and np.median((low + high - 2 * middle)[active]) < 0:
        zero[:], gain[:] = high.max(), -1
        reason = "readings fall when a sensor is pressed, so they are turned round"
    else:
        return unit, None, reason
    return unit, np.stack([zero, gain]), reason


def _changes(counts: Counts, recorded: list[np.ndarray]) -> np.ndarray:
    """The percentiles `STEPS` (2, S) of each channel's changes between successive frames, infinite without changes."""
    before, after = (np.concatenate([index[part] for index in recorded]) for part in (slice(-1), slice(1, None)))
    pairs, steps = evenly(np.arange(len(before)), SAMPLE), np.full((2, counts.shape[1]), np.inf)
    changes = np.abs(counts[after[pairs]].astype(np.float64) - counts[before[pairs]])
    for number, of_channel in enumerate(changes.T):
        if of_channel.any():
            steps[:, number] = np.percentile(of_channel[of_channel > 0], STEPS)
    return steps


def _falling(
    counts: Counts, recorded: list[np.ndarray], noise: np.ndarray, active: np.ndarray
) -> tuple[np.ndarray, bool]:
    """Whether each channel (S,), and the active ones together, mostly read less than where their recordings begin."""
    below, above = np.zeros((2, counts.shape[1]))
    for index in recorded:
        change = counts[evenly(index, max(1, SAMPLE // len(recorded)))] - counts[index[:MIN_FRAMES]].mean(axis=0)
        below += (change < -FAR * noise).sum(axis=0)
        above += (change > FAR * noise).sum(axis=0)
    return below > FALLS * (below + above), bool(below[active].sum() > FALLS * (below + above)[active].sum())


def _ends(values: np.ndarray) -> tuple[float, float]:
    """The smallest and the largest value, of many without a hundredth at either end."""
    ordered, outliers = np.sort(values), int(OUTLIERS * len(values))
    return float(ordered[outliers]), float(ordered[-1 - outliers])
