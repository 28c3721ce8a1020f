"""The empty hand: mean and noise of what sensors read while nothing is touched."""

import numpy as np

from tactile_viewgcn.messages import EMPTY_HAND, UserError, several
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings

Moments = tuple[np.ndarray | None, np.ndarray]  # mean and noise
ROUNDING_SD = 12**-0.5  # standard deviation of rounding to whole steps, in steps
OUTLIER_SD = 3.0  # standard deviations; frames further away are left out, since the empty hand bumps into objects
MAX_PASSES = 5  # over the frames, to leave out outliers
MIN_FRAMES = 5  # for a mean
MOST_FRAMES = 10_000  # for a mean, which then is exact to a hundredth of the noise
CUT_OFF = 0.25  # share of the frames in which a sensor reads the smallest count, if its noise is cut off there
HALF_SD = 0.584  # standard deviation of a normal distribution cut off at its mean, relative to that of the whole
SAMPLE = 2000  # frames that show the noise


def with_empty_hand(recordings: Recordings, frames: np.ndarray) -> np.ndarray:
    """Rising indices of `frames` bool (T,) and of the empty hand in their sessions, on whichever side that is."""
    session = recordings.columns["session"]
    return np.flatnonzero(frames | (recordings.empty_hand & np.isin(session, session[frames])))


def sessions_with_empty_hand(recordings: Recordings) -> np.ndarray:
    """bool (sessions,): sessions with enough frames of the empty hand for a baseline."""
    frames = recordings.columns["session"][recordings.empty_hand]
    return np.bincount(frames, minlength=len(recordings.sessions)) >= MIN_FRAMES


def has_empty_hand(recordings: Recordings) -> bool:
    """Whether every session that has frames has enough of the empty hand for a baseline."""
    return bool(sessions_with_empty_hand(recordings)[recordings.columns["session"]].all())


def require_empty_hand(recordings: Recordings) -> None:
    """Raise a UserError if a session that has frames has too few of the empty hand for a baseline."""
    session, enough = recordings.columns["session"], sessions_with_empty_hand(recordings)
    for number in np.unique(session[~enough[session]])[:1]:
        frames = several(int(recordings.empty_hand[session == number].sum()), "frame")
        raise UserError(
            f"session {recordings.sessions[number]!r} has {frames} of {EMPTY_HAND!r}; preprocess.baseline empty_hand "
            f"needs {MIN_FRAMES} or more: record the empty hand, or set preprocess.baseline to auto"
        )


def session_moments(
    recordings: Recordings, trained: list[tuple[np.ndarray, np.ndarray]] | None = None
) -> list[Moments]:
    """Of each session the mean (S,) of the empty hand and the noise (S,), of the live sensors.

    Without enough frames of the empty hand they are those of `trained`, mean and noise (H, W) of each session from a
    model's training. Without both, the mean is None, and the noise that of differences of successive frames: drift adds
    little to them, and contact changes in few of them.
    """
    session, live = recordings.columns["session"], recordings.live
    moments = [_moments(recordings, np.flatnonzero(session == number)) for number in range(len(recordings.sessions))]
    if not trained:
        return moments
    return [
        (mean[live], noise[live]) if own[0] is None else own
        for own, (mean, noise) in zip(moments, trained, strict=True)
    ]


def _moments(recordings: Recordings, index: np.ndarray) -> Moments:
    """The same of one session, whose frames are `index` (n,)."""
    counts, empty = recordings.live_counts(), index[recordings.empty_hand[index]]
    if len(index) < 2:
        return None, np.ones(counts.shape[1])
    visible = visible_noise(counts[evenly(index, SAMPLE)])
    if len(empty) >= MIN_FRAMES:
        return trimmed_moments(counts[evenly(empty, MOST_FRAMES)], visible)
    sample = evenly(np.arange(len(index) - 1), SAMPLE)
    changes = counts[index[sample + 1]].astype(np.float64) - counts[index[sample]]
    return None, trimmed_moments(changes, visible)[1] / np.sqrt(2)


def trimmed_moments(counts: np.ndarray, visible: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (...) of each sensor over counts (T, ...), without outliers.

    Frames further than three standard deviations from the mean are left out. A median would be no finer than whole
    counts, and the signal's median is one count. The standard deviation is divided by `visible`, see `visible_noise`,
    and at least that of rounding, see `_step`. Differences from the first frame are summed, so that an offset costs no
    digits.
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
    return (first + mean).astype(dtype), np.maximum(spread / visible, rounding).astype(dtype)


def visible_noise(counts: np.ndarray) -> float:
    """Share of the noise's standard deviation that counts (n, S) of live sensors show.

    It is 1, or 0.584 where most sensors often read the smallest of all counts: half of their noise is cut off there.
    """
    return HALF_SD if np.median((counts == counts.min()).mean(axis=0)) > CUT_OFF else 1.0


def _step(counts: np.ndarray) -> float:
    """Step that counts (T, ...) are rounded to: 1 for integers, the smallest gap between real numbers.

    Gaps below eight units of the last digit are rounding errors. If all counts are equal, the step is that unit.
    """
    if counts.dtype.kind in "iu":
        return 1.0
    last_digit = float(np.spacing(np.abs(counts).max()))
    gaps = np.diff(np.unique(counts).astype(np.float64))
    gaps = gaps[gaps > 8 * last_digit]
    return float(gaps.min()) if len(gaps) else last_digit
