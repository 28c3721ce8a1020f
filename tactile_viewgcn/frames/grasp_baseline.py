"""The baseline of each grasp: the open hand before it, for baselines that drift within and between recordings."""

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import (
    MIN_FRAMES,
    MOST_FRAMES,
    Baseline,
    evenly,
    exact_float,
    of_empty_hand,
    trimmed_moments,
)
from tactile_viewgcn.frames.open_hand import OpenHand, frames_by_recording
from tactile_viewgcn.names import EMPTY_HAND
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.readers.source import listed
from tactile_viewgcn.tables.recordings import Recordings

EMPTY, OPEN, KNOWN = "their session's empty hand", "their session's open hand", "the training's baseline"


def grasp_baseline(
    recordings: Recordings, hand: OpenHand, known: list[tuple[np.ndarray, np.ndarray]] | None = None
) -> Baseline:
    """Baseline of each grasp over the open-hand frames since the grasp before it, five at least.

    A grasp without them has those of the nearest earlier grasp of its recording, or else of the nearest later one. A
    recording without any has its session's empty hand; with `known` it has that, else the open hand of the session's
    other recordings, else what is known. The noise is the session's.

    Args:
        hand: of the recordings, as `find_open_hand` returns it.
        known: mean and noise (H, W) of the empty hand of each session, measured before; None: of none.

    Raises:
        UserError: a recording without five open-hand frames, in a session without the empty hand and nothing `known`.
    """
    session, empty = recordings.columns["session"], of_empty_hand(recordings)
    grasp, source = np.zeros((2, len(session)), dtype=np.int64)
    for index in frames_by_recording(recordings):
        grasp[index] = grasp.max() + grasps(hand.open[index], hand.contact[index])
        source[index] = _sources(grasp[index], hand.open[index])
    numbers = np.where(source > 0, source, -session)  # of a grasp, or a session's, which count from 0 down
    used, first, of_frame = np.unique(numbers, return_index=True, return_inverse=True)
    mean = np.empty((len(used), *recordings.shape), dtype=exact_float(recordings.dtype))
    mean[:] = recordings.frames(np.zeros(1, dtype=int))  # cells without a sensor never change
    noise = np.ones_like(mean)
    stand_ins: dict[int, str] = {}
    for row, (number, frame) in enumerate(zip(used, first, strict=True)):
        if number > 0:
            index = hand.open & (grasp == number)
        else:
            index, stand_ins[-number] = empty & (session == -number), EMPTY
            if known and index.sum() < MIN_FRAMES:
                index, stand_ins[-number] = hand.open & (session == -number), OPEN
        if index.sum() >= MIN_FRAMES:
            sample = evenly(np.flatnonzero(index), MOST_FRAMES)
            mean[row, recordings.live] = trimmed_moments(hand.counts[sample])[0]
        elif known:
            mean[row], stand_ins[-number] = known[-number][0], KNOWN
        else:
            raise UserError(
                f"recording {recordings.recordings[recordings.columns['recording'][frame]]!r} has fewer than "
                f"{MIN_FRAMES} open-hand frames, and its session {recordings.sessions[-number]!r} fewer of "
                f"{EMPTY_HAND!r}; preprocess.baseline grasp needs {MIN_FRAMES} of either: record the empty hand, or "
                "set it to auto"
            )
        noise[row, recordings.live] = hand.noise[session[frame]]
    names = [_name(recordings, grasp, number, frame) for number, frame in zip(used, first, strict=True)]
    notes = _notes(recordings, hand.contact, grasp, source, stand_ins)
    return Baseline(names, mean, noise, of_frame.astype(np.int32), notes)


def grasps(opened: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """Number (n,) of the grasp of each frame of a recording, from 1: the next begins as the hand opens after contact.

    Some frames are neither `opened` nor in `contact`, bool (n,).
    """
    certain = np.flatnonzero(opened | contact)
    begins = np.zeros(len(opened), dtype=np.int64)
    begins[certain[1:]] = opened[certain[1:]] & contact[certain[:-1]]
    return 1 + np.cumsum(begins)


def _sources(grasp: np.ndarray, opened: np.ndarray) -> np.ndarray:
    """For each frame of a recording the grasp (n,) whose open hand is its baseline; 0 if none has five frames of it."""
    numbers, count = np.unique(grasp[opened], return_counts=True)
    numbers = numbers[count >= MIN_FRAMES]
    if not len(numbers):
        return np.zeros_like(grasp)
    return numbers[np.maximum(np.searchsorted(numbers, grasp, side="right") - 1, 0)]


def _name(recordings: Recordings, grasp: np.ndarray, number: int, frame: int) -> str:
    """Name of the baseline that a frame has: its session, or its recording and the number of a grasp in it."""
    if number <= 0:
        return recordings.sessions[-number]
    recording = recordings.columns["recording"]
    first = grasp[recording == recording[frame]].min()
    return f"{recordings.recordings[recording[frame]]}, grasp {1 + number - first}"


def _notes(
    recordings: Recordings, contact: np.ndarray, grasp: np.ndarray, source: np.ndarray, stand_ins: dict[int, str]
) -> list[Note]:
    """How many grasps with contact have another's open hand, and which recordings have what instead of one.

    `source` (T,) is the number of the grasp whose open hand a frame has, 0 without one; `stand_ins` says by session
    what its recordings without an open hand have.
    """
    notes, with_contact = [], np.unique(grasp[contact & (source > 0)])
    borrowed = np.intersect1d(with_contact, grasp[(source > 0) & (source != grasp)])
    if len(borrowed):
        text = (
            f"{len(borrowed)} of {several(len(with_contact), 'grasp')}: fewer than {MIN_FRAMES} open-hand frames "
            "before, so those of the nearest grasp of the recording are used"
        )
        notes.append(Note(text, topic="baseline"))
    recording, session = recordings.columns["recording"], recordings.columns["session"]
    for stand_in in dict.fromkeys(stand_ins.values()):
        sessions = [number for number, name in stand_ins.items() if name == stand_in]
        without = np.unique(recording[(source == 0) & np.isin(session, sessions)])
        text = (
            f"{len(without)} of {several(len(np.unique(recording)), 'recording')}: fewer than {MIN_FRAMES} open-hand "
            f"frames, so {stand_in} is used: {listed([recordings.recordings[i] for i in without])}"
        )
        notes.append(Note(text, topic="baseline"))
    return notes
