"""The baseline of each frame, by `preprocess.baseline`: the same for a training's recordings and for new ones."""

from dataclasses import dataclass, field

import numpy as np

from tactile_viewgcn.frames.empty_hand import (
    MIN_FRAMES,
    MOST_FRAMES,
    SAMPLE,
    trimmed_moments,
    visible_noise,
)
from tactile_viewgcn.frames.open_hand import HandStates
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, several
from tactile_viewgcn.params import PreprocessSection
from tactile_viewgcn.readers.source import listed
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
        names: (R,) of the sessions or grasps.
        mean: (R, H, W) counts; float32 if that holds the recordings' counts exactly, else float64.
        noise: (R, H, W) standard deviation in counts, see `visible_noise`; NaN if it was not measured.
        of_frame: int16 or int32 (T,), index of the baseline of each frame of the recordings.
    """

    names: list[str]
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
        return Baseline(["zero"], mean, np.full_like(mean, np.nan), np.zeros(len(recordings), dtype=np.int16))
    if preprocess.baseline == "grasp":
        assert states
        return _of_grasps(recordings, states, trained)
    return _of_sessions(recordings, states, trained)


def join_baselines(parts: list[tuple[np.ndarray, np.ndarray, Baseline]], frames: int) -> Baseline:
    """The baseline of all T frames, from those that were measured on parts of the recordings.

    Args:
        parts: of each the frames bool (T,) that it gives a baseline to, the rising indices (n,) of the frames that it
            was measured on, and that Baseline.
    """
    of_frame, start = np.zeros(frames, dtype=np.int32), 0
    for own, rows, baseline in parts:
        of_frame[own] = start + baseline.of_frame[own[rows]]
        start += len(baseline.names)
    baselines = [baseline for _, _, baseline in parts]
    return Baseline(
        [name for baseline in baselines for name in baseline.names],
        np.concatenate([baseline.mean for baseline in baselines]),
        np.concatenate([baseline.noise for baseline in baselines]),
        of_frame,
        [note for baseline in baselines for note in baseline.notes],
    )


def _of_sessions(recordings: Recordings, states: HandStates | None, trained: list[Moments] | None) -> Baseline:
    session, empty, notes = recordings.columns["session"], recordings.empty_hand, list[Note]()
    unused = (
        np.zeros(recordings.shape, np.float32),
        np.ones(recordings.shape, np.float32),
    )  # of a session without frames
    moments = []
    for number, name in enumerate(recordings.sessions):
        of_session = session == number
        index = np.flatnonzero(of_session & empty)
        if trained and states and len(index) < MIN_FRAMES:
            index = np.flatnonzero(of_session & states.open)
        if len(index) >= MIN_FRAMES:
            sample = recordings.counts[evenly(np.flatnonzero(of_session), SAMPLE)][:, recordings.live]
            moments.append(trimmed_moments(recordings.counts[evenly(index, MOST_FRAMES)], visible_noise(sample)))
        elif trained:
            moments.append(trained[number])
            if of_session.any():
                text = f"session {name!r} has fewer than {MIN_FRAMES} frames of the open hand: the training's is used"
                notes.append(Note(text, topic="baseline"))
        elif of_session.any():
            raise UserError(
                f"session {name!r} has {several(len(index), 'frame')} of {EMPTY_HAND!r}; preprocess.baseline "
                f"empty_hand needs {MIN_FRAMES} or more: record the empty hand, or set preprocess.baseline to auto"
            )
        else:
            moments.append(unused)
    mean, noise = map(np.stack, zip(*moments, strict=True))
    return Baseline(recordings.sessions, mean, noise, session, list(dict.fromkeys(notes)))


def _of_grasps(recordings: Recordings, states: HandStates, trained: list[Moments] | None) -> Baseline:
    """Baseline of each grasp over the open-hand frames since the grasp before it, five at least.

    A grasp with fewer has the baseline of the nearest earlier grasp of its recording, or else of the nearest later one.
    A recording without any has its session's empty hand, else the open hand of its session's other recordings, else
    `trained`, else its five quietest frames. The noise is the session's.
    """
    session, names, recorded = recordings.columns["session"], recordings.recordings, frames_by_recording(recordings)
    rows: dict[tuple[str, int], tuple[np.ndarray, int]] = {}  # by name and session: mean (S,), and index of the row
    of_frame, with_contact, borrowed = np.empty(len(session), dtype=np.int32), 0, 0
    replaced: dict[str, list[str]] = {}  # by what is used instead of an open hand: recordings

    def use(index: np.ndarray, name: str, mean: np.ndarray) -> None:
        of_frame[index] = rows.setdefault((name, int(session[index[0]])), (mean, len(rows)))[1]

    for index, quietest in zip(recorded, states.quiet, strict=True):
        number, name = int(session[index[0]]), names[recordings.columns["recording"][index[0]]]
        grasp = grasps(states.open[index], states.contact[index])
        source = _sources(grasp, states.open[index])
        if source is None:
            kind, mean = _replacement(recordings, states, number, trained) or (QUIETEST, quietest)
            use(index, name if kind == QUIETEST else recordings.sessions[number], mean)
            replaced.setdefault(kind, []).append(name)
            continue
        for one in np.unique(source):
            use(index[source == one], f"{name}, grasp {one}", _mean(states, index[states.open[index] & (grasp == one)]))
        with_contact += len(np.unique(grasp[states.contact[index]]))
        borrowed += len(np.unique(grasp[states.contact[index] & (source != grasp)]))
    mean = np.empty((len(rows), *recordings.shape), dtype=np.result_type(recordings.dtype, np.float32))
    mean[:] = recordings.counts[np.zeros(1, dtype=int)]  # cells without a sensor never change
    noise = np.ones_like(mean)
    mean[:, recordings.live] = [row for row, _ in rows.values()]
    noise[:, recordings.live] = [states.noise[number] for _, number in rows]
    lacking = f"fewer than {MIN_FRAMES} open-hand frames"
    texts = [
        f"{len(without)} of {several(len(recorded), 'recording')}: {lacking}, so {kind} "
        f"{'are' if kind == QUIETEST else 'is'} used: {listed(without)}"
        for kind, without in replaced.items()
    ]
    if borrowed:
        nearest = "those of the nearest grasp of the recording are used"
        texts.insert(0, f"{borrowed} of {several(with_contact, 'grasp')}: {lacking} before, so {nearest}")
    notes = [Note(text, topic="baseline") for text in texts]
    return Baseline([name for name, _ in rows], mean, noise, of_frame, notes)


def grasps(opened: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """Number (n,) of the grasp of each frame of a recording, from 1: the next begins when the hand opens after contact.

    Frames that are neither `opened` nor in `contact`, both bool (n,), belong to the grasp before them.
    """
    certain = np.flatnonzero(opened | contact)
    begins = np.zeros(len(opened), dtype=np.int64)
    begins[certain[1:]] = opened[certain[1:]] & contact[certain[:-1]]
    return 1 + np.cumsum(begins)


def _mean(states: HandStates, index: np.ndarray) -> np.ndarray:
    """Mean (S,) of the live sensors over frames (n,)."""
    return trimmed_moments(states.counts[evenly(index, MOST_FRAMES)])[0]


def _replacement(
    recordings: Recordings, states: HandStates, number: int, trained: list[Moments] | None
) -> tuple[str, np.ndarray] | None:
    """Kind and mean (S,) of the baseline for a recording of session `number` without an open hand; None without any."""
    for kind, usable in ((EMPTY, recordings.empty_hand), (OPEN, states.open)):
        index = np.flatnonzero(usable & (recordings.columns["session"] == number))
        if len(index) >= MIN_FRAMES:
            return kind, _mean(states, index)
    return (TRAINED, trained[number][0][recordings.live]) if trained else None


def _sources(grasp: np.ndarray, opened: np.ndarray) -> np.ndarray | None:
    """For each frame of a recording the grasp (n,) whose open hand is its baseline; None if all have under five."""
    numbers, count = np.unique(grasp[opened], return_counts=True)
    numbers = numbers[count >= MIN_FRAMES]
    return numbers[np.maximum(np.searchsorted(numbers, grasp, side="right") - 1, 0)] if len(numbers) else None
