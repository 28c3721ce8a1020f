"""The baseline of each grasp: the open hand before it, for baselines that drift within and between recordings."""

import numpy as np

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
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.readers.source import listed
from tactile_viewgcn.tables.recordings import Recordings

EMPTY, OPEN, KNOWN = "their session's empty hand", "their session's open hand", "the training's baseline"
QUIETEST = "their own five quietest frames"


def grasp_baseline(
    recordings: Recordings, hand: OpenHand, known: list[tuple[np.ndarray, np.ndarray]] | None = None
) -> Baseline:
    """Baseline of each grasp over the open-hand frames since the grasp before it, five at least.

    A grasp without them has those of the nearest earlier grasp of its recording, or else of the nearest later one. A
    recording without any has its session's empty hand, else the open hand of its session's other recordings, else what
    is known, else its own quietest frames. The noise is the session's.

    Args:
        hand: of the recordings, as `find_open_hand` returns it.
        known: mean and noise (H, W) of the empty hand of each session, measured before; None: of none.
    """
    session, recording = recordings.columns["session"], recordings.columns["recording"]
    rows: dict[tuple[str, int], tuple[np.ndarray, int]] = {}  # by name and session: mean (S,), and index of the row
    of_frame, with_contact, borrowed = np.empty(len(session), dtype=np.int32), 0, 0
    stand_ins: dict[str, list[str]] = {}
    for index, quietest in zip(frames_by_recording(recordings), hand.quiet, strict=True):
        number, name = int(session[index[0]]), recordings.recordings[recording[index[0]]]
        grasp = grasps(hand.open[index], hand.contact[index])
        source = _sources(grasp, hand.open[index])
        for one in np.unique(source[source > 0]):
            mean = _mean(hand, index[hand.open[index] & (grasp == one)])
            of_frame[index[source == one]] = rows.setdefault((f"{name}, grasp {one}", number), (mean, len(rows)))[1]
        if source.any():
            with_contact += len(np.unique(grasp[hand.contact[index]]))
            borrowed += len(np.unique(grasp[hand.contact[index] & (source != grasp)]))
        else:
            kind, mean = _stand_in(recordings, hand, number, known) or (QUIETEST, quietest)
            key = (name if kind == QUIETEST else recordings.sessions[number], number)
            of_frame[index] = rows.setdefault(key, (mean, len(rows)))[1]
            stand_ins.setdefault(kind, []).append(name)
    mean = np.empty((len(rows), *recordings.shape), dtype=exact_float(recordings.dtype))
    mean[:] = recordings.frames(np.zeros(1, dtype=int))  # cells without a sensor never change
    noise = np.ones_like(mean)
    mean[:, recordings.live] = [row for row, _ in rows.values()]
    noise[:, recordings.live] = [hand.noise[number] for _, number in rows]
    notes = []
    if borrowed:
        text = (
            f"{borrowed} of {several(with_contact, 'grasp')}: fewer than {MIN_FRAMES} open-hand frames before, so "
            "those of the nearest grasp of the recording are used"
        )
        notes.append(Note(text, topic="baseline"))
    for kind, without in stand_ins.items():
        text = (
            f"{len(without)} of {several(len(recordings.recordings), 'recording')}: fewer than {MIN_FRAMES} open-hand "
            f"frames, so {kind} {'are' if kind == QUIETEST else 'is'} used: {listed(without)}"
        )
        notes.append(Note(text, topic="baseline"))
    return Baseline([name for name, _ in rows], mean, noise, of_frame, notes)


def grasps(opened: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """Number (n,) of the grasp of each frame of a recording, from 1: the next begins as the hand opens after contact.

    Some frames are neither `opened` nor in `contact`, bool (n,).
    """
    certain = np.flatnonzero(opened | contact)
    begins = np.zeros(len(opened), dtype=np.int64)
    begins[certain[1:]] = opened[certain[1:]] & contact[certain[:-1]]
    return 1 + np.cumsum(begins)


def _mean(hand: OpenHand, index: np.ndarray) -> np.ndarray:
    """Mean (S,) of the live sensors over frames (n,)."""
    return trimmed_moments(hand.counts[evenly(index, MOST_FRAMES)])[0]


def _stand_in(
    recordings: Recordings, hand: OpenHand, number: int, known: list[tuple[np.ndarray, np.ndarray]] | None
) -> tuple[str, np.ndarray] | None:
    """What a recording of session `number` without an open hand has instead, and its mean (S,); None without any."""
    for kind, usable in ((EMPTY, of_empty_hand(recordings)), (OPEN, hand.open)):
        index = np.flatnonzero(usable & (recordings.columns["session"] == number))
        if len(index) >= MIN_FRAMES:
            return kind, _mean(hand, index)
    return (KNOWN, known[number][0][recordings.live]) if known else None


def _sources(grasp: np.ndarray, opened: np.ndarray) -> np.ndarray:
    """For each frame of a recording the grasp (n,) whose open hand is its baseline; 0 if none has five frames of it."""
    numbers, count = np.unique(grasp[opened], return_counts=True)
    numbers = numbers[count >= MIN_FRAMES]
    if not len(numbers):
        return np.zeros_like(grasp)
    return numbers[np.maximum(np.searchsorted(numbers, grasp, side="right") - 1, 0)]
