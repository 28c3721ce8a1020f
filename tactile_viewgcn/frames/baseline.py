"""The baseline of each frame, by `preprocess.baseline`, and the moments of the empty hand that it is made of.

It is the same for a training's recordings and for new ones.
"""

from dataclasses import dataclass, field
from functools import cache, partial

import numpy as np

from tactile_viewgcn.frames.open_hand import MIN_FRAMES, HandStates, Moments
from tactile_viewgcn.messages import Note, listed, several
from tactile_viewgcn.params import PreprocessSection
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

ROUNDING_SD = 12**-0.5  # standard deviation of rounding to whole steps, in steps
# standard deviations; frames further away are left out, since the empty hand bumps into objects
OUTLIER_SD = 3.0
MAX_PASSES = 5  # over the frames, to leave out outliers
MOST_FRAMES = 10_000  # for a mean, which then is exact to a hundredth of the noise
# share of the frames in which a sensor reads the smallest count, if its noise is cut off there
CUT_OFF = 0.25
# standard deviation of a normal distribution cut off at its mean, relative to that of the whole
HALF_SD = 0.584
SAMPLE = 2000  # frames that show the noise
#: What gives the baseline of a recording in which the hand does not open.
EMPTY, OPEN, TRAINED = (
    "their session's empty hand",
    "their session's open hand",
    "the training's baseline",
)
QUIETEST = "their five quietest frames"


@dataclass(frozen=True)
class Baseline:
    """R baselines: one for each session, one for each grasp, or one for all frames.

    Attributes:
        mean: (R, H, W) counts; float32 if that holds the recordings' counts exactly, else float64.
        noise: (R, H, W) standard deviation in counts, see `visible_noise`; NaN if it was not
            measured.
        of_frame: int (T,), index of the baseline of each frame of the recordings.
        notes: on what stands in for an open hand that was not recorded.
    """

    mean: np.ndarray
    noise: np.ndarray
    of_frame: np.ndarray
    notes: list[Note] = field(default_factory=list)


def measure_baseline(
    recordings: Recordings,
    preprocess: PreprocessSection,
    moments: list[Moments],
    states: HandStates | None = None,
) -> Baseline:
    """Measure the baseline that `preprocess.baseline` names.

    - `empty_hand`: of each session over its frames of the empty hand, as the paper subtracts it;
    - `grasp`: of each grasp over the open hand before it; a recording without any has its
      session's, see `_open_hand_of_session`, else its five quietest frames;
    - `none`: the constant `preprocess.zero` for every sensor, as the released code subtracts it,
      with unknown noise.

    Frames of the test side's empty hand count too: it calibrates the glove, and a user records it
    anew in each session. The accuracy of the class empty hand is too high because of that.

    Args:
        moments: of each session, see `session_moments`.
        states: of these recordings; needed by `grasp`, and where a session lacks an empty hand.
    """
    dtype = np.result_type(recordings.counts.dtype, np.float32)
    if preprocess.baseline == "none":
        zero = np.full((1, *recordings.shape), preprocess.zero, dtype)
        return Baseline(zero, np.full_like(zero, np.nan), np.zeros(len(recordings), dtype=np.int16))
    session, recording = recordings.columns["session"], recordings.columns["recording"]
    by_grasp = preprocess.baseline == "grasp"
    parts = [np.flatnonzero(session == number) for number in np.unique(session)]
    if by_grasp:
        parts = frames_by_recording(recordings)
    of_session = cache(partial(_open_hand_of_session, recordings, moments, states))
    of_frame, means, noises = (
        np.empty(len(session), dtype=np.int32),
        list[np.ndarray](),
        list[np.ndarray](),
    )
    shared: dict[int, int] = {}  # by session: the baseline that its recordings share
    # by what is used instead of the baseline that was asked for: recordings
    replaced: dict[str, list[str]] = {}
    for at, index in enumerate(parts):
        number = session[index[0]]
        if by_grasp and states and (own := _of_grasps(states, index)):
            of_frame[index] = len(means) + own[0]
            means += own[1]
            noises += [moments[number][1]] * len(own[1])
            continue
        hand = of_session(number)
        if not hand:
            assert states
            hand = QUIETEST, states.quiet[at], moments[number][1]
        kind, mean, noise = hand
        if kind == QUIETEST or number not in shared:
            shared[number] = len(means)
            means.append(mean)
            noises.append(moments[number][1] if by_grasp else noise)
        of_frame[index] = shared[number]
        if by_grasp or kind == TRAINED:
            replaced.setdefault(kind, []).append(recordings.recordings[recording[index[0]]])
    maps = np.empty((2, len(means), *recordings.shape), dtype)
    # cells without a sensor never change
    maps[0], maps[1] = recordings.counts[np.zeros(1, dtype=int)], 1.0
    maps[..., recordings.live] = means, noises
    total = several(len(np.unique(recording)), "recording")
    texts = (
        f"{len(names)} of {total}: it is from {kind}: {listed(names)}"
        for kind, names in replaced.items()
    )
    return Baseline(maps[0], maps[1], of_frame, [Note(text, topic="baseline") for text in texts])


def _of_grasps(states: HandStates, index: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]] | None:
    """The baseline (n,) of each frame of a recording, counted from 0, and the mean (S,) of each baseline.

    It is that of the open-hand frames since the grasp before, five at least. A grasp with fewer has
    the baseline of the nearest earlier grasp, or else of the nearest later one; None if all have
    fewer.
    """
    opened = states.open[index]
    grasp = grasps(opened, states.contact[index])
    numbers, count = np.unique(grasp[opened], return_counts=True)
    numbers = numbers[count >= MIN_FRAMES]
    if not len(numbers):
        return None
    frames = [evenly(index[opened & (grasp == one)], MOST_FRAMES) for one in numbers]
    nearest = np.maximum(np.searchsorted(numbers, grasp, side="right") - 1, 0)
    return nearest, [trimmed_moments(states.counts[one])[0] for one in frames]


def _open_hand_of_session(
    recordings: Recordings, moments: list[Moments], states: HandStates | None, number: int
) -> tuple[str, np.ndarray, np.ndarray] | None:
    """What stands for the open hand in all of session `number`, its mean (S,) and noise (S,); None without any.

    It is the empty hand, else the open hand of the session's recordings, else what was measured in
    the training.
    """
    mean, noise = moments[number]
    if mean is not None and sessions_with_empty_hand(recordings)[number]:
        return EMPTY, mean, noise
    of_session = recordings.columns["session"] == number
    if states and len(index := np.flatnonzero(of_session & states.open)) >= MIN_FRAMES:
        visible = visible_noise(states.counts[evenly(np.flatnonzero(of_session), SAMPLE)])
        return OPEN, *trimmed_moments(states.counts[evenly(index, MOST_FRAMES)], visible)
    return None if mean is None else (TRAINED, mean, noise)


def grasps(opened: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """Number (n,) of the grasp of each frame of a recording, from 1: the next begins when the hand opens after contact.

    Frames that are neither `opened` nor in `contact`, both bool (n,), belong to the grasp before
    them.
    """
    certain = np.flatnonzero(opened | contact)
    begins = np.zeros(len(opened), dtype=np.int64)
    begins[certain[1:]] = opened[certain[1:]] & contact[certain[:-1]]
    return 1 + np.cumsum(begins)


def with_empty_hand(recordings: Recordings, frames: np.ndarray) -> np.ndarray:
    """Rising indices of `frames` bool (T,) and of the empty hand in their sessions, on whichever side that is."""
    session = recordings.columns["session"]
    return np.flatnonzero(frames | (recordings.empty_hand & np.isin(session, session[frames])))


def sessions_with_empty_hand(recordings: Recordings) -> np.ndarray:
    """bool (sessions,): sessions with enough frames of the empty hand for a baseline."""
    frames = recordings.columns["session"][recordings.empty_hand]
    return np.bincount(frames, minlength=len(recordings.sessions)) >= MIN_FRAMES


def without_empty_hand(recordings: Recordings) -> list[str]:
    """Names of the sessions that have frames, but too few of the empty hand for a baseline."""
    enough, recorded = (
        sessions_with_empty_hand(recordings),
        np.unique(recordings.columns["session"]),
    )
    return [recordings.sessions[number] for number in recorded if not enough[number]]


def session_moments(
    recordings: Recordings, trained: list[tuple[np.ndarray, np.ndarray]] | None = None
) -> list[Moments]:
    """Of each session the mean (S,) of the empty hand and the noise (S,), of the live sensors.

    Without enough frames of the empty hand they are those of `trained`, mean and noise (H, W) of
    each session from a model's training. Without both, the mean is None, and the noise that of
    differences of successive frames: drift adds little to them, and contact changes in few of them.
    """
    session, live = recordings.columns["session"], recordings.live
    moments = [
        _moments(recordings, np.flatnonzero(session == number))
        for number in range(len(recordings.sessions))
    ]
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

    Frames further than three standard deviations from the mean are left out. A median would be no
    finer than whole counts, and the signal's median is one count. The standard deviation is divided
    by `visible`, see `visible_noise`, and at least that of rounding, see `_step`. Differences from
    the first frame are summed, so that an offset costs no digits.
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

    It is 1, or 0.584 where most sensors often read the smallest of all counts: half of their noise
    is cut off there.
    """
    return HALF_SD if np.median((counts == counts.min()).mean(axis=0)) > CUT_OFF else 1.0


def _step(counts: np.ndarray) -> float:
    """Step that counts (T, ...) are rounded to: 1 for integers, the smallest gap between real numbers.

    Gaps below eight units of the last digit are rounding errors. If all counts are equal, the step
    is that unit.
    """
    if counts.dtype.kind in "iu":
        return 1.0
    last_digit = float(np.spacing(np.abs(counts).max()))
    gaps = np.diff(np.unique(counts).astype(np.float64))
    return float(min(gaps[gaps > 8 * last_digit], default=last_digit))
