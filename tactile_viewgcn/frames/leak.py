"""The leak check: do frames without contact predict the object? Then an error says little about touch."""

import numpy as np

from tactile_viewgcn.frames.baseline import Baseline, of_empty_hand
from tactile_viewgcn.frames.open_hand import OpenHand
from tactile_viewgcn.frames.quick_error import QuickError, quick_error
from tactile_viewgcn.messages import Note, several
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

TOPIC = "leak check"


def check_leak(recordings: Recordings, baseline: Baseline, hand: OpenHand, group: np.ndarray) -> QuickError | None:
    """Error of recognising objects by open-hand frames; None unless two objects have such frames in two groups each.

    The baseline of the last frame of contact before is subtracted: one of the open hand itself would hide its own
    drift. The empty hand is no object here.

    Args:
        group: (T,) split group of each frame.
    """

    def excess(index: np.ndarray) -> np.ndarray:
        of_frame = baseline.of_frame[_last_contact(recordings, hand.contact)[index]]
        return hand.counts[index] - baseline.mean[of_frame][:, recordings.live]

    untouched = hand.open & ~of_empty_hand(recordings)
    return quick_error("leak", excess, untouched, recordings.columns["object"], group)


def check_first_frames(recordings: Recordings, hand: OpenHand) -> QuickError | None:
    """Error of recognising objects by the first frame of each recording; None unless two objects have two recordings.

    The mean over the first frames of the session is subtracted. The empty hand is no object here.
    """
    first = np.zeros(len(hand.open), dtype=bool)
    first[[index[0] for index in frames_by_recording(recordings)]] = True

    def excess(index: np.ndarray) -> np.ndarray:
        counts, session = hand.counts[index].astype(np.float64), recordings.columns["session"][index]
        for number in np.unique(session):
            counts[session == number] -= counts[session == number].mean(axis=0)
        return counts

    usable, columns = first & ~of_empty_hand(recordings), recordings.columns
    return quick_error("first frame", excess, usable, columns["object"], columns["recording"])


def leak_counts(leak: QuickError | None) -> dict[str, float]:
    """The numbers of a leak check by the names that they are logged under."""
    names = ("error", "low", "high", "chance", "groups", "frames", "seconds")
    return {f"leak.{name}": getattr(leak, name) for name in names} if leak else {}


def leak_notes(recordings: Recordings, hand: OpenHand, leak: QuickError | None, *, advised: bool) -> list[Note]:
    """A leak check in one line, or why there is none, and a warning where the objects are recognised.

    Args:
        advised: to set the baseline to `grasp` is a remedy.
    """
    if leak is None:
        frames = int((hand.open & ~of_empty_hand(recordings)).sum())
        text = "not checked: no frame of an object is without contact"
        if frames:
            text = f"not checked: {several(frames, 'frame')} without contact, not of two objects in two groups each"
        return [Note(text, topic=TOPIC)]
    text = (
        f"frames without contact predict the object with an error of {100 * leak.error:.1f} % "
        f"({100 * leak.low:.1f} to {100 * leak.high:.1f}), chance {100 * leak.chance:.1f} %; "
        f"{several(leak.frames, 'frame')} in {several(leak.groups, 'group')}, {leak.seconds:.1f} s"
    )
    notes = [Note(text, topic=TOPIC)]
    if leak.beats_chance:
        text = "frames without contact predict the object better than chance, so errors say less about touch"
        if advised:
            text += ": set preprocess.baseline to grasp, or choose another split.by"
            notes.append(Note(text, "warning", TOPIC, "preprocess.baseline", "grasp"))
        else:
            notes.append(Note(f"{text}: choose another split.by", "warning", TOPIC))
    return notes


def _last_contact(recordings: Recordings, contact: np.ndarray) -> np.ndarray:
    """Index (T,) of the last frame of contact before each frame in its recording; the frame itself if there is none."""
    last = np.arange(len(contact))
    for index in frames_by_recording(recordings):
        before = np.maximum.accumulate(np.where(contact[index], np.arange(len(index)), -1))
        last[index] = np.where(before < 0, index, index[before])
    return last
