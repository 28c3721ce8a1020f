"""The baseline of each sensor: mean and noise of its readings without contact."""

from dataclasses import dataclass, field

import numpy as np

from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, several
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings

ROUNDING_SD = 12**-0.5  # standard deviation of rounding to whole steps, in steps
OUTLIER_SD = 3.0  # standard deviations; frames further away are left out, since the empty hand bumps into objects
MAX_PASSES = 5  # over the frames, to leave out outliers
MIN_FRAMES = 5  # for a mean
CUT_OFF = 0.25  # share of the frames in which a sensor reads the smallest count, if its noise is cut off there
HALF_SD = 0.584  # standard deviation of a normal distribution cut off at its mean, relative to that of the whole
SAMPLE = 2000  # frames that show whether noise is cut off
MOST_FRAMES = 10_000  # for a mean, which then is exact to a hundredth of the noise


@dataclass(frozen=True)
class Baseline:
    """R baselines: one for each session, one for each grasp, or one for all frames.

    Attributes:
        names: (R,) of the sessions or grasps.
        mean: (R, H, W) counts; float32 if that holds the recordings' counts exactly, else float64.
        noise: (R, H, W) standard deviation in counts, see `noise_left`; NaN if it was not measured.
        of_frame: int16 or int32 (T,), index of the baseline of each frame of the recordings.
    """

    names: list[str]
    mean: np.ndarray
    noise: np.ndarray
    of_frame: np.ndarray
    notes: list[Note] = field(default_factory=list)


def trimmed_moments(counts: np.ndarray, left: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (H, W) of each sensor over counts (T, H, W), without outliers.

    Frames further than three standard deviations from the mean are left out. A median would be no finer than whole
    counts, and the signal's median is one count. The standard deviation is divided by `left`, see `noise_left`, and at
    least that of rounding, see `_step`. Differences from the first frame are summed, so that an offset costs no digits.
    """
    dtype, first = np.result_type(counts.dtype, np.float32), counts[0].astype(np.float64)
    rounding = ROUNDING_SD * _step(counts)
    values = counts - first
    inside = np.ones(values.shape, dtype=bool)
    for _ in range(MAX_PASSES):
        mean = values.mean(axis=0, where=inside)
        spread = values.std(axis=0, where=inside)
        tighter = np.abs(values - mean) <= OUTLIER_SD * np.maximum(spread, rounding)
        if (tighter == inside).all():
            break
        inside = tighter
    return (first + mean).astype(dtype), np.maximum(spread / left, rounding).astype(dtype)


def noise_left(recordings: Recordings) -> float:
    """Share of the noise's standard deviation that the recordings show.

    It is 1, or 0.584 where most sensors often read the smallest of all counts: half of their noise is cut off there.
    """
    counts = recordings.counts[evenly(np.arange(len(recordings)), SAMPLE)][:, recordings.live]
    return HALF_SD if np.median((counts == counts.min()).mean(axis=0)) > CUT_OFF else 1.0


def _step(counts: np.ndarray) -> float:
    """Step that counts (T, H, W) are rounded to: 1 for integers, the smallest gap between real numbers.

    Gaps below eight units of the last digit are rounding errors. If all counts are equal, the step is that unit.
    """
    if counts.dtype.kind in "iu":
        return 1.0
    last_digit = float(np.spacing(np.abs(counts).max()))
    gaps = np.diff(np.unique(counts).astype(np.float64))
    gaps = gaps[gaps > 8 * last_digit]
    return float(gaps.min()) if len(gaps) else last_digit


def of_empty_hand(recordings: Recordings) -> np.ndarray:
    """bool (T,): frames of recordings of the empty hand."""
    number = recordings.objects.index(EMPTY_HAND) if EMPTY_HAND in recordings.objects else -1
    return recordings.columns["object"] == number


def has_empty_hand(recordings: Recordings) -> bool:
    """Whether every session has enough frames of the empty hand for a baseline."""
    session, empty = recordings.columns["session"], of_empty_hand(recordings)
    counts = np.bincount(session[empty], minlength=len(recordings.sessions))
    return bool((counts[np.unique(session)] >= MIN_FRAMES).all())


def empty_hand_baseline(recordings: Recordings) -> Baseline:
    """Baseline of each session over its frames of the empty hand, as the paper subtracts it.

    Frames of the test side count too: the baseline calibrates the glove, and a user records it anew in each session.
    The accuracy of the class empty hand is too high because of that.

    Raises:
        UserError: a session without enough frames of the empty hand.
    """
    sessions, empty = recordings.columns["session"], of_empty_hand(recordings)
    unused = np.zeros(recordings.shape, np.float32), np.ones(recordings.shape, np.float32)  # no frames
    moments, left = [], noise_left(recordings)
    for number, name in enumerate(recordings.sessions):
        index = np.flatnonzero(empty & (sessions == number))
        if len(index) < MIN_FRAMES and (sessions == number).any():
            raise UserError(
                f"session {name!r} has {several(len(index), 'frame')} of {EMPTY_HAND!r}; preprocess.baseline "
                f"empty_hand needs {MIN_FRAMES} or more: record the empty hand, or set preprocess.baseline to auto"
            )
        frames = recordings.counts[evenly(index, MOST_FRAMES)]
        moments.append(trimmed_moments(frames, left) if len(index) else unused)
    mean, noise = map(np.stack, zip(*moments, strict=True))
    return Baseline(recordings.sessions, mean, noise, sessions)


def constant_baseline(recordings: Recordings, zero: float) -> Baseline:
    """Baseline of `zero` counts for every sensor, as the released code subtracts it; its noise is unknown."""
    mean = np.full((1, *recordings.shape), zero, dtype=np.result_type(recordings.dtype, np.float32))
    return Baseline(["zero"], mean, np.full_like(mean, np.nan), np.zeros(len(recordings), dtype=np.int16))
