"""The baseline of each frame, by `preprocess.baseline`, and the moments of the empty hand.

It is measured alike on the training, validation and test set and on new recordings.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

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
MEAN_FRAMES = 10_000  # most for a mean, which then is exact to a hundredth of the noise
NOISE_FRAMES = 2000  # most that show the noise
# share of the frames in which a sensor reads the smallest count, if its noise is cut off there
CUT_OFF = 0.25
# standard deviation of a normal distribution cut off at its mean, relative to that of the whole
HALF_SD = 0.584
#: Fallbacks for the baseline of a recording in which the hand never opens, as notes name them.
EMPTY = "their session's empty hand"
OPEN = "their session's open hand"
TRAINED = "the training's baseline"
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


class _OpenHand(NamedTuple):
    """What stands for the open hand: name in notes, mean (S,) and noise (S,) in counts."""

    kind: str
    mean: np.ndarray
    noise: np.ndarray


class _Measured:
    """Baselines of recordings, as they are measured one after another."""

    def __init__(self, recordings: Recordings):
        self.recordings = recordings
        self.of_frame = np.empty(len(recordings), dtype=np.int32)
        self.means = list[np.ndarray]()
        self.noises = list[np.ndarray]()
        self.replaced = dict[str, list[str]]()  # by fallback: names of recordings

    def add(self, mean: np.ndarray, noise: np.ndarray) -> int:
        """Add a baseline of mean (S,) and noise (S,), and return its index."""
        self.means.append(mean)
        self.noises.append(noise)
        return len(self.means) - 1

    def replace(self, kind: str, frame: int) -> None:
        """Note that the recording of a frame has a fallback."""
        recording = self.recordings.columns["recording"][frame]
        self.replaced.setdefault(kind, []).append(self.recordings.recordings[recording])

    def baseline(self) -> Baseline:
        """Return all baselines as maps of the sensors, and a note on each fallback."""
        recordings = self.recordings
        shape = (len(self.means), *recordings.shape)
        # cells without a sensor never change
        mean = np.empty(shape, _dtype(recordings))
        mean[:] = recordings.counts[np.zeros(1, dtype=int)]
        mean[:, recordings.live] = self.means
        noise = np.ones_like(mean)
        noise[:, recordings.live] = self.noises
        total = several(len(np.unique(recordings.columns["recording"])), "recording")
        notes = [
            Note(f"{len(names)} of {total}: it is from {kind}: {listed(names)}", topic="baseline")
            for kind, names in self.replaced.items()
        ]
        return Baseline(mean, noise, self.of_frame, notes)


def _dtype(recordings: Recordings) -> np.dtype:
    """Return the type of a baseline, which holds the recordings' counts exactly."""
    return np.result_type(recordings.counts.dtype, np.float32)


def measure_baseline(
    recordings: Recordings,
    params: PreprocessSection,
    moments: list[Moments],
    states: HandStates | None = None,
) -> Baseline:
    """Return the baseline that `preprocess.baseline` names.

    - `empty_hand`: the mean of each session's frames of the empty hand, as the paper subtracts it.
    - `grasp`: the mean of the open hand before each grasp. A recording without an open hand has a
      fallback: its session's open hand, see `_open_hand_of_session`, else its five quietest frames.
    - `none`: the constant `preprocess.zero` for every sensor, as the released code subtracts it,
      with unknown noise.

    Frames of the test set's empty hand count too: it calibrates the glove, and a user records it
    anew in each session. The accuracy of the class empty hand is too high because of that.

    Args:
        recordings: T frames.
        params: the settings of a plan.
        moments: of each session, see `session_moments`.
        states: of these recordings. They are needed by `grasp`, and where a session lacks an empty
            hand.

    Raises:
        ValueError: a baseline that is none of these.
    """
    match params.baseline:
        case "none":
            return _constant(recordings, params.zero)
        case "empty_hand":
            return _of_sessions(recordings, moments, states)
        case "grasp":
            assert states
            return _of_grasps(recordings, moments, states)
    raise ValueError(f"no such baseline: {params.baseline}")


def _constant(recordings: Recordings, zero: float) -> Baseline:
    """Return one baseline for all frames, whose noise is not known."""
    mean = np.full((1, *recordings.shape), zero, _dtype(recordings))
    of_frame = np.zeros(len(recordings), dtype=np.int16)
    return Baseline(mean, np.full_like(mean, np.nan), of_frame)


def _of_sessions(
    recordings: Recordings, moments: list[Moments], states: HandStates | None
) -> Baseline:
    """Return a baseline for each session: its empty hand, or what stands in for it."""
    measured = _Measured(recordings)
    session = recordings.columns["session"]
    for number in np.unique(session):
        index = np.flatnonzero(session == number)
        hand = _open_hand_of_session(recordings, moments, states, number)
        assert hand
        measured.of_frame[index] = measured.add(hand.mean, hand.noise)
        if hand.kind == TRAINED:
            measured.replace(TRAINED, index[0])
    return measured.baseline()


def _of_grasps(recordings: Recordings, moments: list[Moments], states: HandStates) -> Baseline:
    """Return a baseline for each grasp, and fallbacks for recordings without an open hand."""
    measured = _Measured(recordings)
    hands = dict[int, _OpenHand | None]()
    shared = dict[int, int]()  # by session: the baseline that its recordings share
    for row, index in enumerate(frames_by_recording(recordings)):
        number = recordings.columns["session"][index[0]]
        _, noise = moments[number]
        grasp, means = _open_hand_of_grasps(states, index)
        if means:
            measured.of_frame[index] = len(measured.means) + grasp
            for mean in means:
                measured.add(mean, noise)
            continue
        if number not in hands:
            hands[number] = _open_hand_of_session(recordings, moments, states, number)
        hand = hands[number]
        if hand is None:
            measured.of_frame[index] = measured.add(states.quiet[row], noise)
            measured.replace(QUIETEST, index[0])
            continue
        if number not in shared:
            shared[number] = measured.add(hand.mean, noise)
        measured.of_frame[index] = shared[number]
        measured.replace(hand.kind, index[0])
    return measured.baseline()


def _open_hand_of_grasps(
    states: HandStates, index: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the open hand before each grasp of a recording.

    Uses the open-hand frames since the previous grasp, at least five. A grasp with fewer has the
    baseline of the nearest earlier grasp, or else of the nearest later one.

    Args:
        states: of the recordings.
        index: (n,) the recording's frames.

    Returns:
        The index (n,) of each frame's baseline, and the mean (S,) of each baseline in counts. There
        are no means if every grasp has too few open-hand frames.
    """
    opened = states.open[index]
    grasp = grasps(opened, states.contact[index])
    numbers, frames = np.unique(grasp[opened], return_counts=True)
    numbers = numbers[frames >= MIN_FRAMES]
    means = []
    for number in numbers:
        open_frames = evenly(index[opened & (grasp == number)], MEAN_FRAMES)
        mean, _ = trimmed_moments(states.counts[open_frames])
        means.append(mean)
    nearest = np.maximum(np.searchsorted(numbers, grasp, side="right") - 1, 0)
    return nearest, means


def _open_hand_of_session(
    recordings: Recordings, moments: list[Moments], states: HandStates | None, number: int
) -> _OpenHand | None:
    """Return what stands for the open hand in all of a session; None without anything.

    It is the empty hand, else the open hand of the session's recordings, else what the training set
    measured.
    """
    mean, noise = moments[number]
    if mean is not None and sessions_with_empty_hand(recordings)[number]:
        return _OpenHand(EMPTY, mean, noise)
    of_session = recordings.columns["session"] == number
    if states:
        index = np.flatnonzero(of_session & states.open)
        if len(index) >= MIN_FRAMES:
            sample = evenly(np.flatnonzero(of_session), NOISE_FRAMES)
            visible = visible_noise(states.counts[sample])
            counts = states.counts[evenly(index, MEAN_FRAMES)]
            return _OpenHand(OPEN, *trimmed_moments(counts, visible))
    if mean is None:
        return None
    return _OpenHand(TRAINED, mean, noise)


def grasps(opened: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """Return the number (n,) of the grasp of each frame of a recording, from 1.

    The next grasp begins when the hand opens after contact. Frames that are neither open nor in
    contact belong to the grasp before them.

    Args:
        opened: bool (n,), frames of the open hand.
        contact: bool (n,), frames in contact.
    """
    certain = np.flatnonzero(opened | contact)
    begins = np.zeros(len(opened), dtype=np.int64)
    begins[certain[1:]] = opened[certain[1:]] & contact[certain[:-1]]
    return 1 + np.cumsum(begins)


def with_empty_hand(recordings: Recordings, frames: np.ndarray) -> np.ndarray:
    """Return rising indices of frames bool (T,) and of the empty hand in their sessions.

    The empty hand is taken from whichever set it is in.
    """
    session = recordings.columns["session"]
    return np.flatnonzero(frames | (recordings.empty_hand & np.isin(session, session[frames])))


def sessions_with_empty_hand(recordings: Recordings) -> np.ndarray:
    """Return bool (sessions,): sessions with enough frames of the empty hand for a baseline."""
    frames = recordings.columns["session"][recordings.empty_hand]
    return np.bincount(frames, minlength=len(recordings.sessions)) >= MIN_FRAMES


def without_empty_hand(recordings: Recordings) -> list[str]:
    """Return the names of sessions with frames, but too few of the empty hand for a baseline."""
    is_enough = sessions_with_empty_hand(recordings)
    recorded = np.unique(recordings.columns["session"])
    return [recordings.sessions[number] for number in recorded if not is_enough[number]]


def session_moments(recordings: Recordings, trained: list[Moments] | None = None) -> list[Moments]:
    """Return the mean (S,) of the empty hand and the noise (S,) of each session's live sensors.

    Without enough frames of the empty hand they are the session's of `trained`. Without both, the
    mean is None, and the noise is measured on differences of successive frames: drift adds little
    to them, and contact changes in few of them.

    Args:
        recordings: T frames.
        trained: what the training set measured in each of these sessions.
    """
    session = recordings.columns["session"]
    moments = []
    for number in range(len(recordings.sessions)):
        measured = _moments(recordings, np.flatnonzero(session == number))
        mean, _ = measured
        if mean is None and trained:
            measured = trained[number]
        moments.append(measured)
    return moments


def _moments(recordings: Recordings, index: np.ndarray) -> Moments:
    """Return the same for one session, whose frames are `index` (n,)."""
    counts = recordings.live_counts()
    if len(index) < 2:
        return None, np.ones(counts.shape[1])
    visible = visible_noise(counts[evenly(index, NOISE_FRAMES)])
    empty = index[recordings.empty_hand[index]]
    if len(empty) >= MIN_FRAMES:
        return trimmed_moments(counts[evenly(empty, MEAN_FRAMES)], visible)
    sample = evenly(np.arange(len(index) - 1), NOISE_FRAMES)
    changes = counts[index[sample + 1]].astype(np.float64) - counts[index[sample]]
    _, noise = trimmed_moments(changes, visible)
    return None, noise / np.sqrt(2)


def trimmed_moments(counts: np.ndarray, visible: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean and the standard deviation (...) of each sensor, without outliers.

    Frames further than three standard deviations from the mean are left out. A median would be no
    finer than whole counts, and the signal's median is one count. Differences from the first frame
    are summed, so that an offset costs no digits.

    Args:
        counts: (T, ...).
        visible: see `visible_noise`; the standard deviation is divided by it, and is at least that
            of rounding, see `_step`.
    """
    dtype = np.result_type(counts.dtype, np.float32)
    first = counts[0].astype(np.float64)
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
    """Return the share of the noise's standard deviation that counts (n, S) of live sensors show.

    It is 1, or 0.584 where most sensors often read the smallest of all counts: half of their noise
    is cut off there.
    """
    is_smallest = counts == counts.min()
    if np.median(is_smallest.mean(axis=0)) > CUT_OFF:
        return HALF_SD
    return 1.0


def _step(counts: np.ndarray) -> float:
    """Return the step that counts (T, ...) are rounded to.

    It is 1 for integers, and the smallest gap between real numbers. Gaps below eight units of the
    last digit are rounding errors. If all counts are equal, the step is that unit.
    """
    if counts.dtype.kind in "iu":
        return 1.0
    last_digit = float(np.spacing(np.abs(counts).max()))
    gaps = np.diff(np.unique(counts).astype(np.float64))
    return float(min(gaps[gaps > 8 * last_digit], default=last_digit))
