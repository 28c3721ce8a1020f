"""The quietest frames of each recording: an open hand, or contact as all the others?"""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.frames.baseline import MIN_FRAMES
from tactile_viewgcn.frames.open_hand import OpenHand, quietest

MOST_ACTIVE = 0.2  # share of a recording's frames that are compared with its quietest
ALIKE = 0.2  # by so much two recordings of one object are more alike than those of two objects: a cosine


@dataclass(frozen=True)
class Quiet:
    """What R recordings read when they read least, at S sensors.

    Attributes:
        mean: (R, S) over the five quietest successive frames, in counts.
        pressed: (R,) sensors that differ from the session's median recording by more than the contact threshold.
        similarity: mean cosine of what remains of two recordings of one object, less that of two objects; None where
            no object has two recordings.
    """

    mean: np.ndarray
    pressed: np.ndarray
    similarity: float | None


def find_quiet(
    hand: OpenHand, frames: list[np.ndarray], label: np.ndarray, session: np.ndarray, *, sigmas: float
) -> Quiet:
    """The quietest frames of each recording.

    Args:
        frames: indices of the frames of each recording.
        label, session: (R,) index of its object and session.
        sigmas: standard deviations above the baseline of a sensor in contact.
    """
    mean = np.empty((len(frames), hand.counts.shape[1]))
    for row, index in enumerate(frames):
        counts = hand.counts[index].astype(np.float64)
        start = quietest(counts)
        mean[row] = counts[start : start + MIN_FRAMES].mean(axis=0)
    rest = np.empty_like(mean)
    for number in np.unique(session):
        of_session = session == number
        rest[of_session] = mean[of_session] - np.median(mean[of_session], axis=0)
    pressed = (np.abs(rest) > sigmas * hand.noise[session]).sum(axis=1)
    return Quiet(mean, pressed, _similarity(rest, label, session))


def all_in_contact(quiet: Quiet, opened: np.ndarray, contact: np.ndarray, *, sensors: int) -> bool:
    """Whether even the quietest frames of the recordings are contact.

    They differ between recordings by contact, and by more than a drifting baseline does: there are hardly any frames
    like them in a recording, or no frames unlike them, or they are alike in recordings of one object.

    Args:
        opened, contact: (R,) frames of the open hand and of contact, if the quietest are an open hand.
        sensors: fewest that are in contact in a frame of contact.
    """
    if np.median(quiet.pressed) < sensors:
        return False
    alike = quiet.similarity is not None and quiet.similarity > ALIKE
    return bool(np.median(opened) < MIN_FRAMES or np.median(contact) == 0 or alike)


def _similarity(rest: np.ndarray, label: np.ndarray, session: np.ndarray) -> float | None:
    """See `Quiet`; of recordings (R, S). Pairs in two sessions count if there are some: drift does not come again."""
    centred = rest - rest.mean(axis=1, keepdims=True)
    length = np.linalg.norm(centred, axis=1, keepdims=True)
    unit = centred / np.where(length > 0, length, 1)
    cosine, same = unit @ unit.T, label[:, None] == label
    apart = session[:, None] != session
    pairs = same & apart if (same & apart).any() else same & ~np.eye(len(label), dtype=bool)
    if not pairs.any() or same.all():
        return None
    return float(cosine[pairs].mean() - cosine[~same].mean())
