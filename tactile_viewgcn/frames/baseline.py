"""The rest of each sensor: what it reads while nothing touches it, and how much that scatters."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.recordings import EMPTY_HAND, Recordings

QUANTISATION = 12**-0.5  # sd, in the last digit's steps, that rounding leaves in a sensor that never varies
CUT = 3.0  # standard deviations beyond which a frame is no rest: the empty hand bumps into things
PASSES = 5
FEWEST = 5  # frames that a mean is taken over


@dataclass(frozen=True)
class Rest:
    """Rest per session, or per recording with `quiet`.

    Attributes:
        names: whose rest each entry is, R of them.
        mean: (R, H, W) counts, float32 where that holds the recordings' own counts exactly, else float64.
        noise: (R, H, W) counts, the standard deviation; None where no rest was measured.
        of_frame: int16 (T,), the entry that belongs to each frame of the recordings.
    """

    names: list[str]
    mean: np.ndarray
    noise: np.ndarray | None
    of_frame: np.ndarray


def trimmed(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Per-sensor mean and standard deviation (H, W) of counts (T, H, W), outliers cut.

    The signal's median is one count, so a median of whole counts would show its rounding; a mean without the
    frames beyond three standard deviations does not. The noise is at least that of the rounding, see `_step`. Sums are
    of differences from the first frame, which a large offset leaves exact.
    """
    kind, first = _precise(counts.dtype), counts[0].astype(np.float64)
    rounding = QUANTISATION * _step(counts)
    values = counts - first
    inside = np.ones(values.shape, dtype=bool)
    for _ in range(PASSES):
        mean = values.mean(axis=0, where=inside)
        noise = np.maximum(values.std(axis=0, where=inside), rounding)
        tighter = np.abs(values - mean) <= CUT * noise
        tighter |= ~tighter.any(axis=0)  # two values far apart: neither is the outlier
        if (tighter == inside).all():
            break
        inside = tighter
    return (first + mean).astype(kind), noise.astype(kind)


def _step(counts: np.ndarray) -> float:
    """What counts (T, H, W) are rounded to: 1 for whole numbers; of real ones the smallest gap between two of them.

    Gaps of less than eight last digits are rounding themselves. Where all are equal it is the last digit.
    """
    if counts.dtype.kind in "iu":
        return 1.0
    last = float(np.spacing(np.abs(counts).max()))
    gaps = np.diff(np.unique(counts).astype(np.float64))
    gaps = gaps[gaps > 8 * last]
    return float(gaps.min()) if len(gaps) else last


def _precise(kind: np.dtype) -> np.dtype:
    """float32 for counts that it holds exactly, else float64."""
    return np.result_type(kind, np.float32)


def empty_hand_rest(recordings: Recordings) -> Rest:
    """Rest over the empty-hand recordings of each session, as the paper subtracts it.

    All of a session's empty-hand frames count, those on the test side too: the rest is a calibration of the glove,
    which a user of a new session has to record as well. The empty hand's own accuracy is flattered by it.

    Raises:
        ValueError: a session without enough frames of the empty hand.
    """
    sessions = recordings.columns["session"]
    empty = recordings.columns["object"] == _empty_hand_index(recordings)
    entries = []
    for number, name in enumerate(recordings.sessions):
        index = np.flatnonzero(empty & (sessions == number))
        if len(index) < FEWEST and (sessions == number).any():
            raise ValueError(
                f"session {name!r} has {len(index)} frames of {EMPTY_HAND!r}; preprocess.baseline "
                f"empty_hand needs {FEWEST} or more: record the empty hand, or set it to quiet"
            )
        entries.append(trimmed(recordings.frames(index)) if len(index) else _nothing(recordings))
    mean, noise = map(np.stack, zip(*entries, strict=True))
    return Rest(recordings.sessions, mean, noise, sessions)


def quiet_rest(recordings: Recordings, share: float) -> Rest:
    """Rest over each recording's own quietest frames, for data without an empty hand.

    The quietest are the `share` of a recording's frames with the smallest sum over the sensors, at least five.
    """
    owner, entries = recordings.columns["recording"], []
    for number in range(len(recordings.recordings)):
        index = np.flatnonzero(owner == number)
        if not len(index):
            entries.append(_nothing(recordings))
            continue
        counts = recordings.frames(index)
        activity = counts.sum(axis=(1, 2), dtype=np.float64)
        fewest = min(len(counts), max(FEWEST, round(share * len(counts))))
        entries.append(trimmed(counts[np.argsort(activity, kind="stable")[:fewest]]))
    mean, noise = map(np.stack, zip(*entries, strict=True))
    return Rest(recordings.recordings, mean, noise, owner)


def no_rest(recordings: Recordings, zero: float) -> Rest:
    """The same constant for every sensor, as the released code subtracts it."""
    mean = np.full((1, *recordings.shape), zero, dtype=_precise(recordings.dtype))
    return Rest(["zero"], mean, None, np.zeros(len(recordings), dtype=np.int16))


def _nothing(recordings: Recordings) -> tuple[np.ndarray, np.ndarray]:
    """The entry of a session or recording without frames: nothing ever refers to it."""
    return np.zeros(recordings.shape, np.float32), np.ones(recordings.shape, np.float32)


def _empty_hand_index(recordings: Recordings) -> int:
    if EMPTY_HAND not in recordings.objects:
        raise ValueError(
            f"no object is named {EMPTY_HAND!r}; preprocess.baseline empty_hand needs its frames: "
            "record the empty hand, or set preprocess.baseline to quiet"
        )
    return recordings.objects.index(EMPTY_HAND)
