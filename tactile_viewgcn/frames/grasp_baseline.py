"""The baseline of each grasp: the open hand before it, for baselines that drift within and between recordings."""

import numpy as np

from tactile_viewgcn.frames.baseline import (
    MIN_FRAMES,
    MOST_FRAMES,
    Baseline,
    of_empty_hand,
    trimmed_moments,
)
from tactile_viewgcn.frames.open_hand import OpenHand
from tactile_viewgcn.messages import Note, several
from tactile_viewgcn.readers.source import listed
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

EMPTY, OPEN, TRAINED = "their session's empty hand", "their session's open hand", "the training's baseline"
QUIETEST = "their five quietest frames"


def grasp_baseline(
    recordings: Recordings, hand: OpenHand, trained: list[tuple[np.ndarray, np.ndarray]] | None = None
) -> Baseline:
    """Baseline of each grasp over the open-hand frames since the grasp before it, five at least.

    A grasp with fewer has the baseline of the nearest earlier grasp of its recording, or else of the nearest later one.
    A recording without any has its session's empty hand, else the open hand of its session's other recordings, else
    `trained`, else its five quietest frames. The noise is the session's.

    Args:
        hand: of the recordings, as `find_open_hand` returns it.
        trained: mean and noise (H, W) for each session, from the training of a model; None without a model.
    """
    session, names, recorded = recordings.columns["session"], recordings.recordings, frames_by_recording(recordings)
    rows: dict[tuple[str, int], tuple[np.ndarray, int]] = {}  # by name and session: mean (S,), and index of the row
    of_frame, with_contact, borrowed = np.empty(len(session), dtype=np.int32), 0, 0
    replaced: dict[str, list[str]] = {}  # by what is used instead of an open hand: recordings

    def use(index: np.ndarray, name: str, mean: np.ndarray) -> None:
        of_frame[index] = rows.setdefault((name, int(session[index[0]])), (mean, len(rows)))[1]

    for index, quietest in zip(recorded, hand.quiet, strict=True):
        number, name = int(session[index[0]]), names[recordings.columns["recording"][index[0]]]
        grasp = grasps(hand.open[index], hand.contact[index])
        source = _sources(grasp, hand.open[index])
        if source is None:
            kind, mean = _replacement(recordings, hand, number, trained) or (QUIETEST, quietest)
            use(index, name if kind == QUIETEST else recordings.sessions[number], mean)
            replaced.setdefault(kind, []).append(name)
            continue
        for one in np.unique(source):
            use(index[source == one], f"{name}, grasp {one}", _mean(hand, index[hand.open[index] & (grasp == one)]))
        with_contact += len(np.unique(grasp[hand.contact[index]]))
        borrowed += len(np.unique(grasp[hand.contact[index] & (source != grasp)]))
    mean = np.empty((len(rows), *recordings.shape), dtype=np.result_type(recordings.dtype, np.float32))
    mean[:] = recordings.counts[np.zeros(1, dtype=int)]  # cells without a sensor never change
    noise = np.ones_like(mean)
    mean[:, recordings.live] = [row for row, _ in rows.values()]
    noise[:, recordings.live] = [hand.noise[number] for _, number in rows]
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


def _mean(hand: OpenHand, index: np.ndarray) -> np.ndarray:
    """Mean (S,) of the live sensors over frames (n,)."""
    return trimmed_moments(hand.counts[evenly(index, MOST_FRAMES)])[0]


def _replacement(
    recordings: Recordings, hand: OpenHand, number: int, trained: list[tuple[np.ndarray, np.ndarray]] | None
) -> tuple[str, np.ndarray] | None:
    """Kind and mean (S,) of the baseline for a recording of session `number` without an open hand; None without any."""
    for kind, usable in ((EMPTY, of_empty_hand(recordings)), (OPEN, hand.open)):
        index = np.flatnonzero(usable & (recordings.columns["session"] == number))
        if len(index) >= MIN_FRAMES:
            return kind, _mean(hand, index)
    return (TRAINED, trained[number][0][recordings.live]) if trained else None


def _sources(grasp: np.ndarray, opened: np.ndarray) -> np.ndarray | None:
    """For each frame of a recording the grasp (n,) whose open hand is its baseline; None if all have under five."""
    numbers, count = np.unique(grasp[opened], return_counts=True)
    numbers = numbers[count >= MIN_FRAMES]
    return numbers[np.maximum(np.searchsorted(numbers, grasp, side="right") - 1, 0)] if len(numbers) else None
