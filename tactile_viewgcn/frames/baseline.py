"""The baseline of each frame, by `preprocess.baseline`.

Training, validation and test set and new recordings are all measured in the same way.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from tactile_viewgcn.frames.moments import (
    MEAN_FRAMES,
    MIN_FRAMES,
    NOISE_FRAMES,
    Moments,
    trimmed_moments,
    visible_noise,
)
from tactile_viewgcn.frames.open_hand import HandStates
from tactile_viewgcn.messages import EMPTY_HAND, Note, listed, several
from tactile_viewgcn.params import PreprocessSection
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

#: Fallbacks for the baseline of a recording in which the hand never opens, as notes name them.
EMPTY = "the session's empty hand"
OPEN = "the session's open hand"
TRAINED = "the training set's baseline"
QUIETEST = "the five quietest frames"
EMPTY_HAND_TOO = (
    "If the hand was open in them, give the empty hand of their session too: in a folder "
    f"{EMPTY_HAND} next to them, or in Python as the argument {EMPTY_HAND}"
)
OTHER_SESSION = f"If the hand was open in them, {EMPTY_HAND} is not of their session"


@dataclass(frozen=True)
class Baseline:
    """R baselines: one for each session, one for each grasp, or one for all frames.

    Attributes:
        mean: (R, H, W) counts. They are float32 if that holds the recordings' counts exactly, else
            float64.
        noise: (R, H, W) standard deviation in counts, see `Moments`. It is NaN if it was not
            measured.
        of_frame: int (T,), index of the baseline of each frame of the recordings.
        fallbacks: numbers of the recordings that have a fallback, by the names of what they lack
            and of the fallback.
    """

    mean: np.ndarray
    noise: np.ndarray
    of_frame: np.ndarray
    fallbacks: dict[tuple[str, str], list[int]] = field(default_factory=dict)

    def notes(self, recordings: Recordings, *, own_open_hand: bool = False) -> list[Note]:
        """Return a note on each fallback in these recordings; it names recordings of objects only.

        Args:
            recordings: the recordings.
            own_open_hand: whether the recordings are new, and most training recordings show an open
                hand of their own. Then the note on new recordings without one is a warning if the
                training set's baseline replaces it, or if more than half of them have none: their
                answers are often wrong if their open hand only reads otherwise.
        """
        of_objects = set(recordings.columns["recording"][~recordings.empty_hand].tolist())
        total = several(len(of_objects), "recording")
        notes = list[Note]()
        for (lacking, fallback), replaced in self.fallbacks.items():
            numbers = [number for number in replaced if number in of_objects]
            if not numbers:
                continue
            names = listed([recordings.recordings[number] for number in numbers])
            text = f"in {len(numbers)} of {total} no {lacking} was found"
            remedy = ""
            if fallback == TRAINED:
                text += " that reads like the training set's"
                remedy = EMPTY_HAND_TOO
            elif fallback == EMPTY and own_open_hand and len(numbers) > len(of_objects) / 2:
                remedy = OTHER_SESSION
            text += f"; {fallback} replaces it: {names}"
            if remedy:
                text += f". {remedy}"
            note = Note(text, topic="baseline")
            if remedy and own_open_hand:
                note = replace(note, level="warning")
            notes.append(note)
        return notes


class _OpenHand(NamedTuple):
    """An open hand or its fallback: name in notes, mean (S,) and noise (S,) in counts."""

    kind: str
    mean: np.ndarray
    noise: np.ndarray


class _Measured:
    """The baselines that have been measured so far, one after another.

    Args:
        recordings: the recordings.
        source: what gives a recording its baseline, unless there is a fallback.
    """

    def __init__(self, recordings: Recordings, source: str):
        self.recordings = recordings
        self.source = source
        self.of_frame = np.empty(len(recordings), dtype=np.int32)
        self.means = list[np.ndarray]()
        self.noises = list[np.ndarray]()
        self.fallbacks = dict[tuple[str, str], list[int]]()  # see `Baseline`

    def add(self, mean: np.ndarray, noise: np.ndarray) -> int:
        """Add a baseline of mean (S,) and noise (S,), and return its index."""
        self.means.append(mean)
        self.noises.append(noise)
        return len(self.means) - 1

    def replace(self, kind: str, frame: int) -> None:
        """Remember that the recording of a frame has this kind of fallback."""
        number = int(self.recordings.columns["recording"][frame])
        self.fallbacks.setdefault((self.source, kind), []).append(number)

    def baseline(self) -> Baseline:
        """Return all baselines as maps of the sensors."""
        recordings = self.recordings
        shape = (len(self.means), *recordings.shape)
        # cells without a sensor never change
        mean = np.empty(shape, _dtype(recordings))
        mean[:] = recordings.counts[np.zeros(1, dtype=int)]
        mean[:, recordings.live] = self.means
        noise = np.ones_like(mean)
        noise[:, recordings.live] = self.noises
        return Baseline(mean, noise, self.of_frame, self.fallbacks)


def _dtype(recordings: Recordings) -> np.dtype:
    """Return a type for baselines that holds the recordings' counts exactly."""
    return np.result_type(recordings.counts.dtype, np.float32)


def measure_baseline(
    recordings: Recordings,
    params: PreprocessSection,
    moments: list[Moments],
    states: HandStates | None = None,
) -> Baseline:
    """Return the baseline that `preprocess.baseline` names.

    - `empty_hand`: the mean of each session's frames of the empty hand. The paper subtracts it.
    - `grasp`: the mean of the open hand before each grasp. A recording without an open hand has a
      fallback: the open hand of its session, see `_open_hand_of_session`. If the session has none,
      the fallback is the five quietest frames of the recording.
    - `none`: the constant `preprocess.zero` for every sensor, with unknown noise. The released code
      subtracts it.

    The test set's frames of the empty hand are used too: they calibrate the glove, and a user
    records them again in each session. For that reason the error rate of the class empty hand is
    too low.

    Args:
        recordings: T frames.
        params: the settings of a plan.
        moments: the moments of each session, see `session_moments`.
        states: the states of the hand in these recordings. They are needed for `grasp`, and if a
            session lacks an empty hand.

    Raises:
        ValueError: the baseline is none of these.
    """
    match params.baseline:
        case "none":
            return _constant(recordings, params.zero)
        case "empty_hand":
            return _of_sessions(recordings, moments, states)
        case "grasp":
            assert states
            return _of_grasps(recordings, moments, states)
    raise ValueError(f"unknown preprocess.baseline {params.baseline!r}")


def _constant(recordings: Recordings, zero: float) -> Baseline:
    """Return one baseline of unknown noise for all frames."""
    mean = np.full((1, *recordings.shape), zero, _dtype(recordings))
    of_frame = np.zeros(len(recordings), dtype=np.int16)
    return Baseline(mean, np.full_like(mean, np.nan), of_frame)


def _of_sessions(
    recordings: Recordings, moments: list[Moments], states: HandStates | None
) -> Baseline:
    """Return a baseline for each session: its empty hand, or a fallback."""
    measured = _Measured(recordings, "empty or open hand")
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
    measured = _Measured(recordings, "open hand")
    hands = dict[int, _OpenHand | None]()
    shared = dict[int, int]()  # the baseline that the recordings of a session share, by session
    for row, index in enumerate(frames_by_recording(recordings)):
        number = recordings.columns["session"][index[0]]
        noise = moments[number].noise
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
            shared[number] = measured.add(hand.mean, moments[number].session_noise)
        measured.of_frame[index] = shared[number]
        measured.replace(hand.kind, index[0])
    return measured.baseline()


def _open_hand_of_grasps(
    states: HandStates, index: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the open hand before each grasp of a recording.

    Uses the open-hand frames since the previous grasp, at least five. A grasp with fewer takes the
    baseline of the nearest earlier grasp, or, if there is none, of the nearest later grasp.

    Args:
        states: the states of the hand in all recordings.
        index: (n,) the frames of one recording.

    Returns:
        The index (n,) of each frame's baseline, and the mean (S,) of each baseline in counts. If
        every grasp has too few open-hand frames, there are no means.
    """
    opened = states.open[index]
    grasp, numbers = grasps_after_open_hand(opened, states.contact[index])
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
    """Return the open hand of a session, or a fallback; None if there is neither.

    The session's empty hand comes first, then the open hand of the session's recordings, then the
    baseline of the training set.
    """
    mean = moments[number].mean
    noise = moments[number].session_noise
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
    """Return the number (n,) of the grasp of each frame of a recording, counted from 1.

    The next grasp begins when the hand opens after contact. Frames that are neither open nor in
    contact belong to the previous grasp.

    Args:
        opened: bool (n,), frames of the open hand.
        contact: bool (n,), frames in contact.
    """
    certain = np.flatnonzero(opened | contact)
    begins = np.zeros(len(opened), dtype=np.int64)
    begins[certain[1:]] = opened[certain[1:]] & contact[certain[:-1]]
    return 1 + np.cumsum(begins)


def grasps_after_open_hand(
    opened: np.ndarray, contact: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the number (n,) of each frame's grasp, and the numbers that have a baseline.

    These are the grasps with five open-hand frames or more since the previous grasp.

    Args:
        opened: bool (n,), frames of the open hand.
        contact: bool (n,), frames in contact.
    """
    grasp = grasps(opened, contact)
    numbers, frames = np.unique(grasp[opened], return_counts=True)
    return grasp, numbers[frames >= MIN_FRAMES]


def with_empty_hand(recordings: Recordings, frames: np.ndarray) -> np.ndarray:
    """Return rising indices of some frames bool (T,) and of the empty hand in their sessions.

    The set of an empty hand does not matter here.
    """
    session = recordings.columns["session"]
    return np.flatnonzero(frames | (recordings.empty_hand & np.isin(session, session[frames])))


def sessions_with_empty_hand(recordings: Recordings) -> np.ndarray:
    """Return bool (sessions,), the sessions with enough empty-hand frames for a baseline."""
    frames = recordings.columns["session"][recordings.empty_hand]
    return np.bincount(frames, minlength=len(recordings.sessions)) >= MIN_FRAMES


def short_empty_hands(recordings: Recordings) -> list[str]:
    """Return the names of recordings of an empty hand that has too few frames for a baseline."""
    is_enough = sessions_with_empty_hand(recordings)[recordings.columns["session"]]
    numbers = np.unique(recordings.columns["recording"][recordings.empty_hand & ~is_enough])
    return [recordings.recordings[number] for number in numbers]


def without_empty_hand(recordings: Recordings) -> list[str]:
    """Return the names of recorded sessions with too few empty-hand frames for a baseline."""
    is_enough = sessions_with_empty_hand(recordings)
    recorded = np.unique(recordings.columns["session"])
    return [recordings.sessions[number] for number in recorded if not is_enough[number]]
