"""What the sensors of recordings read: percentiles, faulty sensors, and mean frames and time lines for pictures."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.frames.baseline import evenly
from tactile_viewgcn.frames.open_hand import OpenHand

PERCENTILES = (0, 1, 50, 99, 100)
MOST_ROWS = 2000  # frames of which percentiles and histograms are computed
POINTS = 100  # of a time line, at most
BINS = 60
STUCK = 0.1  # of the median sensor's standard deviation
SATURATED = 0.01  # share of frames at the largest reading there is


@dataclass(frozen=True)
class Readings:
    """What S live sensors read in R recordings of O objects.

    Attributes:
        percentiles: (5,) of all readings, in counts: 0, 1, 50, 99 and 100.
        above: (5,) of the readings of sensors in contact, in counts above the baseline; NaN without any.
        pressed_share: of the readings of held frames, how many are of sensors in contact.
        stuck: bool (H, W) sensors that vary by less than a tenth of what the median sensor does.
        saturated: (H, W) share of frames in which a sensor reads the largest number that any does; 0 everywhere where
            only one reading is that large.
        histogram, edges: (B,) numbers of readings above the baseline in held frames; (B + 1,) their limits in counts.
        mean_frame: (O, H, W) mean counts above the baseline in frames of contact, NaN of an object without any.
        activity: for each recording, up to 100 means over the sensors, in counts above the baseline, in order.
        held: for each of these, the share of its frames that are held.
    """

    percentiles: np.ndarray
    above: np.ndarray
    pressed_share: float
    stuck: np.ndarray
    saturated: np.ndarray
    histogram: np.ndarray
    edges: np.ndarray
    mean_frame: np.ndarray
    activity: list[np.ndarray]
    held: list[np.ndarray]


def measure_readings(
    hand: OpenHand,
    frames: list[np.ndarray],
    baseline: np.ndarray,
    label: np.ndarray,
    *,
    live: np.ndarray,
    objects: int,
    held: np.ndarray,
    threshold: np.ndarray,
) -> Readings:
    """The readings of each recording above a baseline of its own.

    Args:
        frames: indices of the frames of each recording.
        baseline: (R, S) counts; label: (R,) object.
        live: bool (H, W).
        held: bool (T,) frames of contact, the empty hand's left out.
        threshold: (R, S) counts above the baseline of a sensor in contact.
    """
    sums, number = np.zeros((objects, hand.counts.shape[1])), np.zeros(objects)
    low, high, at_high = np.inf, -np.inf, np.zeros(hand.counts.shape[1], dtype=np.int64)
    activity, of_activity, samples, pressed = [], [], [], []
    each = max(1, MOST_ROWS // len(frames))
    for row, index in enumerate(frames):
        points, counts = min(POINTS, len(index)), hand.counts[index]
        low = min(low, counts.min())
        if counts.max() > high:
            high, at_high[:] = counts.max(), 0
        at_high += (counts == high).sum(axis=0)
        lines = [part.mean() for part in np.array_split(counts.mean(axis=1), points)]
        activity.append(np.array(lines) - baseline[row].mean())
        of_activity.append(np.array([part.mean() for part in np.array_split(held[index], points)]))
        counts = counts[held[index]]
        if not len(counts):
            continue
        sums[label[row]] += counts.sum(axis=0, dtype=np.float64) - len(counts) * baseline[row]
        number[label[row]] += len(counts)
        excess = counts[evenly(np.arange(len(counts)), each)] - baseline[row]
        samples.append(excess.ravel())
        pressed.append(excess[excess > threshold[row]])
    excess = np.concatenate(samples) if samples else np.zeros(0)
    above = np.concatenate(pressed) if pressed else np.zeros(0)
    every = hand.counts[evenly(np.arange(len(hand.counts)), MOST_ROWS)]
    histogram, edges = np.histogram(excess, BINS, _limits(excess))
    means = np.where(number[:, None] > 0, sums / np.maximum(number, 1)[:, None], np.nan)
    percentiles = np.percentile(every, PERCENTILES)
    percentiles[0], percentiles[-1] = low, high
    return Readings(
        percentiles=percentiles,
        above=np.percentile(above, PERCENTILES) if len(above) else np.full(len(PERCENTILES), np.nan),
        pressed_share=len(above) / max(1, len(excess)),
        stuck=scatter(_stuck(every), live),
        saturated=scatter(at_high / len(hand.counts) if at_high.sum() > 1 else np.zeros(len(at_high)), live),
        histogram=histogram,
        edges=edges,
        mean_frame=np.stack([scatter(mean, live) for mean in means]),
        activity=activity,
        held=of_activity,
    )


def _limits(excess: np.ndarray) -> tuple[float, float]:
    """Of a histogram: without the thousandths at its ends."""
    low, high = np.percentile(excess, [0.1, 99.9]) if len(excess) else (0.0, 1.0)
    return (low, high) if low < high else (low - 1, high + 1)


def _stuck(counts: np.ndarray) -> np.ndarray:
    """bool (S,): sensors that hardly vary in counts (n, S)."""
    spread = counts.std(axis=0)
    return spread < STUCK * np.median(spread)


def scatter(values: np.ndarray, live: np.ndarray) -> np.ndarray:
    """Values (S,) of the live sensors as (H, W); 0 elsewhere."""
    out = np.zeros(live.shape, dtype=values.dtype)
    out[live] = values
    return out
