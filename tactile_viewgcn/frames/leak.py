"""The leak check: can the object be told from frames without contact? Then an error says little about touch."""

import numpy as np

from tactile_viewgcn.frames.baseline import Baseline, of_empty_hand
from tactile_viewgcn.frames.open_hand import OpenHand, frames_by_recording
from tactile_viewgcn.frames.quick_error import QuickError, quick_error
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.tables.recordings import Recordings


def check_leak(
    recordings: Recordings,
    baseline: Baseline,
    hand: OpenHand,
    group: np.ndarray,
    usable: np.ndarray | bool = True,
) -> QuickError | None:
    """Tell the objects apart by open-hand frames; None without such frames that can be held out.

    From a frame the baseline is subtracted that the last frame of contact before it has, as from a grasp: a baseline of
    the open hand itself would hide its own drift. The empty hand is no object here, and an object needs two groups.

    Args:
        group: (T,) split group of each frame.
        usable: bool (T,) frames that may be used.
    """

    def excess(index: np.ndarray) -> np.ndarray:
        of_frame = baseline.of_frame[_last_contact(recordings, hand.contact)[index]]
        return hand.counts[index] - baseline.mean[of_frame][:, recordings.live]

    without_contact = hand.open & ~of_empty_hand(recordings) & usable
    return quick_error("leak", excess, without_contact, recordings.columns["object"], group)


def check_first_frames(recordings: Recordings, hand: OpenHand) -> QuickError | None:
    """Tell the objects apart by the first frame of each recording alone; None where none can be held out.

    From a frame the mean of the first frames of its session is subtracted. The empty hand is no object here, and an
    object needs two recordings.
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
    """The numbers by the names that they are logged under."""
    names = ("error", "low", "high", "chance", "groups", "frames", "seconds")
    return {f"leak.{name}": getattr(leak, name) for name in names} if leak else {}


def leak_notes(leak: QuickError | None, *, advised: bool) -> list[Note]:
    """A leak check in one line, and a warning where the object is told, with the advice to take the baseline grasp."""
    if leak is None:
        return [Note("no open-hand frames of two objects, each in two groups: not checked", topic="leak check")]
    text = (
        f"the object is told from frames without contact with an error of {100 * leak.error:.1f} % "
        f"({100 * leak.low:.1f} to {100 * leak.high:.1f}), chance {100 * leak.chance:.1f} %; "
        f"{several(leak.frames, 'frame')} in {several(leak.groups, 'group')}, {leak.seconds:.1f} s"
    )
    notes = [Note(text, topic="leak check")]
    if leak.tells_object:
        text = "the object is told without contact better than by chance, so that errors say less about touch"
        if advised:
            text += ": set preprocess.baseline to grasp, or choose another split.by"
            notes.append(Note(text, "warning", "leak check", "preprocess.baseline", "grasp"))
        else:
            notes.append(Note(f"{text}: choose another split.by", "warning", "leak check"))
    return notes


def _last_contact(recordings: Recordings, contact: np.ndarray) -> np.ndarray:
    """Index (T,) of the last frame of contact before each frame in its recording; its own where there is none."""
    last = np.arange(len(contact))
    for index in frames_by_recording(recordings):
        before = np.maximum.accumulate(np.where(contact[index], np.arange(len(index)), -1))
        last[index] = np.where(before < 0, index, index[before])
    return last
