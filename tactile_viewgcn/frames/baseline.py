"""The baseline of each frame, by `preprocess.baseline`: the same for a training's recordings and for new ones."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from tactile_viewgcn.frames.empty_hand import (
    MIN_FRAMES,
    MOST_FRAMES,
    SAMPLE,
    session_moments,
    trimmed_moments,
    visible_noise,
)
from tactile_viewgcn.frames.open_hand import HandStates
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, listed, several
from tactile_viewgcn.params import PreprocessSection
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

Moments = tuple[np.ndarray, np.ndarray]  # mean and noise
#: What gives the baseline of a recording in which the hand does not open.
EMPTY, OPEN, TRAINED = "their session's empty hand", "their session's open hand", "the training's baseline"
QUIETEST = "their five quietest frames"


@dataclass(frozen=True)
class Baseline:
    """R baselines: one for each session, one for each grasp, or one for all frames.

    Attributes:
        mean: (R, H, W) counts; float32 if that holds the recordings' counts exactly, else float64.
        noise: (R, H, W) standard deviation in counts, see `visible_noise`; NaN if it was not measured.
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
    states: HandStates | None = None,
    trained: list[Moments] | None = None,
) -> Baseline:
    """Measure the baseline that `preprocess.baseline` names.

    - `empty_hand`: of each session over its frames of the empty hand, as the paper subtracts it;
    - `grasp`: of each grasp over the open hand before it;
    - `none`: the constant `preprocess.zero` for every sensor, as the released code subtracts it, with unknown noise.

    Frames of the test side's empty hand count too: it calibrates the glove, and a user records it anew in each session.
    The accuracy of the class empty hand is too high because of that.

    Args:
        states: of these recordings; needed by `grasp`, and by `empty_hand` with `trained`.
        trained: mean and noise (H, W) of each session from a model's training. With them no session is refused: the
            open hand stands in for an empty hand that was not recorded, and the training's baseline for both.

    Raises:
        UserError: `empty_hand` without `trained`, and the empty hand was not recorded in a session.
    """
    if preprocess.baseline == "none":
        mean = np.full((1, *recordings.shape), preprocess.zero, dtype=np.result_type(recordings.dtype, np.float32))
        return Baseline(mean, np.full_like(mean, np.nan), np.zeros(len(recordings), dtype=np.int16))
    if preprocess.baseline == "grasp":
        assert states
        return _of_grasps(recordings, states, trained)
    return _of_sessions(recordings, states, trained)


def _of_sessions(recordings: Recordings, states: HandStates | None, trained: list[Moments] | None) -> Baseline:
    session, live = recordings.columns["session"], int(recordings.live.sum())
    unknown = "", np.zeros(live), np.ones(live)
    means, noises, notes = list[np.ndarray](), list[np.ndarray](), list[Note]()
    for number, name in enumerate(recordings.sessions):
        frames = session == number
        kind, mean, noise = _open_hand_of_session(recordings, states, trained, number) or unknown
        if kind != EMPTY and not trained and frames.any():
            raise UserError(
                f"session {name!r} has {several(int((frames & recordings.empty_hand).sum()), 'frame')} of "
                f"{EMPTY_HAND!r}; preprocess.baseline empty_hand needs {MIN_FRAMES} or more: record the empty hand, or "
                "set preprocess.baseline to auto"
            )
        if kind == TRAINED and frames.any():
            text = f"session {name!r} has fewer than {MIN_FRAMES} frames of the open hand: the training's is used"
            notes.append(Note(text, topic="baseline"))
        means.append(mean)
        noises.append(noise)
    return _on_all_cells(recordings, means, noises, session, list(dict.fromkeys(notes)))


def _of_grasps(recordings: Recordings, states: HandStates, trained: list[Moments] | None) -> Baseline:
    """Baseline of each grasp over the open-hand frames since the grasp before it, five at least.

    A grasp with fewer has the baseline of the nearest earlier grasp of its recording, or else of the nearest later one.
    A recording without any has that of its session, see `_open_hand_of_session`, else its five quietest frames. The
    noise is the session's.
    """
    session, recording = recordings.columns["session"], recordings.columns["recording"]
    of_session = cache(lambda number: _open_hand_of_session(recordings, states, trained, number))
    of_frame, means, sessions = np.empty(len(session), dtype=np.int32), list[np.ndarray](), list[int]()
    shared: dict[int, int] = {}  # by session: the baseline of its recordings without an open hand
    replaced: dict[str, list[str]] = {}  # by what is used instead of an open hand: recordings
    recorded = frames_by_recording(recordings)
    for index, quietest in zip(recorded, states.quiet, strict=True):
        number, grasp = int(session[index[0]]), grasps(states.open[index], states.contact[index])
        source = _sources(grasp, states.open[index])
        if source is None:
            kind, mean, _ = of_session(number) or (QUIETEST, quietest, None)
            if kind == QUIETEST or number not in shared:
                shared[number] = len(means)
                means.append(mean)
                sessions.append(number)
            of_frame[index] = shared[number]
            replaced.setdefault(kind, []).append(recordings.recordings[recording[index[0]]])
            continue
        for one in np.unique(source):
            of_frame[index[source == one]] = len(means)
            opened = index[states.open[index] & (grasp == one)]
            means.append(trimmed_moments(states.counts[evenly(opened, MOST_FRAMES)])[0])
            sessions.append(number)
    notes = [
        Note(
            f"{len(names)} of {several(len(recorded), 'recording')} without {MIN_FRAMES} open-hand frames: baseline "
            f"from {kind}: {listed(names)}",
            topic="baseline",
        )
        for kind, names in replaced.items()
    ]
    return _on_all_cells(recordings, means, [states.noise[number] for number in sessions], of_frame, notes)


def _open_hand_of_session(
    recordings: Recordings, states: HandStates | None, trained: list[Moments] | None, number: int
) -> tuple[str, np.ndarray, np.ndarray] | None:
    """What stands for the open hand in all of session `number`, its mean (S,) and noise (S,); None without any.

    It is the empty hand, else the open hand of the session's recordings, else what was measured in the training.
    """
    mean, noise = session_moments(recordings, number)
    if mean is not None:
        return EMPTY, mean, noise
    if states:
        of_session = recordings.columns["session"] == number
        index = np.flatnonzero(of_session & states.open)
        if len(index) >= MIN_FRAMES:
            visible = visible_noise(states.counts[evenly(np.flatnonzero(of_session), SAMPLE)])
            return OPEN, *trimmed_moments(states.counts[evenly(index, MOST_FRAMES)], visible)
    return (TRAINED, *(values[recordings.live] for values in trained[number])) if trained else None


def _on_all_cells(
    recordings: Recordings, means: list, noises: list, of_frame: np.ndarray, notes: list[Note]
) -> Baseline:
    """The Baseline of means and noises (R, S) of the live sensors."""
    mean = np.empty((len(means), *recordings.shape), dtype=np.result_type(recordings.dtype, np.float32))
    mean[:] = recordings.counts[np.zeros(1, dtype=int)]  # cells without a sensor never change
    noise = np.ones_like(mean)
    mean[:, recordings.live], noise[:, recordings.live] = np.stack(means), np.stack(noises)
    return Baseline(mean, noise, of_frame, notes)


def grasps(opened: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """Number (n,) of the grasp of each frame of a recording, from 1: the next begins when the hand opens after contact.

    Frames that are neither `opened` nor in `contact`, both bool (n,), belong to the grasp before them.
    """
    certain = np.flatnonzero(opened | contact)
    begins = np.zeros(len(opened), dtype=np.int64)
    begins[certain[1:]] = opened[certain[1:]] & contact[certain[:-1]]
    return 1 + np.cumsum(begins)


def _sources(grasp: np.ndarray, opened: np.ndarray) -> np.ndarray | None:
    """For each frame of a recording the grasp (n,) whose open hand is its baseline; None if all have under five."""
    numbers, count = np.unique(grasp[opened], return_counts=True)
    numbers = numbers[count >= MIN_FRAMES]
    return numbers[np.maximum(np.searchsorted(numbers, grasp, side="right") - 1, 0)] if len(numbers) else None
