"""Zero, sign and unit of the channels: one for all, or each its own where they are of unlike kind."""

import numpy as np

from tactile_viewgcn.frames.baseline import MIN_FRAMES
from tactile_viewgcn.tables.counts import Counts, evenly
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

SAMPLE = 2000  # frames, or pairs of successive frames, that are compared
ENDS = (0.1, 50, 99.9)  # percentiles of a channel's readings; its range is from the first to the last
STEPS = (0, 1, 50)  # percentiles of its changes from frame to frame, but for zeros: smallest, finest hundredth, noise
NOISY = 8.0  # times its noise; a channel of a smaller range shows nothing else
LEAST = 20.0  # times its noise: the smallest range that counts as full scale, so that noise alone stays small
ROUNDING = 1e-6  # of a channel's readings
SOUND = (1, 99)  # percentiles of the channels; those beyond may be faulty
UNLIKE = 10.0  # ratio of ranges, and of small changes, of unlike channels
FAR, FALLS = 5.0, 0.8  # times the noise from a recording's first frames; share of such readings that lies below them
FULL_SCALE = 100.0  # per cent


def measure_units(recordings: Recordings, asked: str) -> tuple[str, np.ndarray | None, str]:
    """The value of `preprocess.unit`, zero and gain of each channel, and the reason, measured on training recordings.

    With `each` readings become per cent of the channel's range. With `one` they stay as they are, but are turned round
    where they fall when a sensor is pressed. `auto` is `each` where three things differ tenfold between channels: the
    range, the smallest change between frames, which is 1 for counts of any gain, and the finest hundredth of the
    changes, which noise makes alike where the smallest is chance. Frames that stand alone show no changes: `one`.

    Returns:
        `one` or `each`; (2, H, W), by which a reading r becomes (r - zero) * gain, or None: it stays r; a text.
    """
    counts, recorded = recordings.live_counts(), frames_by_recording(recordings)
    sample = counts[evenly(np.arange(len(counts)), SAMPLE)]
    low, middle, high = np.percentile(sample, ENDS, axis=0, method="nearest").astype(np.float64)
    span, (smallest, fine, noise) = high - low, _changes(counts, recorded)
    active = (span > NOISY * noise) & (span > ROUNDING * np.abs([low, high]).max(axis=0))
    falls, all_fall, unit, reason = *_falling(counts, recorded, noise, active), "one", "all sensors are of one kind"
    if active.any():
        compared = np.stack([span, smallest, fine])[:, active]
        least, most = np.percentile(compared, SOUND, axis=1, method="inverted_cdf")
        if (most > UNLIKE * least).all():
            unit, reason = "each", f"channels are of unlike kind: ranges from {least[0]:.3g} to {most[0]:.3g}"
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
    """The percentiles `STEPS` (3, S) of each channel's changes between successive frames, infinite without changes."""
    before, after = (np.concatenate([index[part] for index in recorded]) for part in (slice(-1), slice(1, None)))
    pairs, steps = evenly(np.arange(len(before)), SAMPLE), np.full((len(STEPS), counts.shape[1]), np.inf)
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
