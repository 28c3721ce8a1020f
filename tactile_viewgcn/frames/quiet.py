"""The quietest frames of each recording: an open hand, or contact as all the others?"""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.frames.baseline import MIN_FRAMES
from tactile_viewgcn.frames.open_hand import OpenHand, quietest

MOST_ACTIVE = 0.2  # share of a recording's frames that are compared with its quietest
ALIKE = 0.2  # by so much two recordings of one object are more alike than those of two objects: a cosine
GROWS = 0.25  # correlation over sensors of what the quietest frames read with what is added to it
BY_CHANCE = 5.0  # so many standard deviations of that correlation of two random patterns
COMPARABLE = 0.5  # spread over the sensors of the quietest frames, in spreads of what is added to them


@dataclass(frozen=True)
class Quiet:
    """What R recordings read when they read least, at S sensors.

    Attributes:
        mean: (R, S) over the five quietest successive frames, in counts.
        pressed: (R,) sensors that differ from the session's median recording by more than the contact threshold.
        similarity: mean cosine of what remains of two recordings of one object, less that of two objects; None where
            no object has two recordings.
        growth: (R,) correlation over the sensors of the quietest frames with what the most active ones add to them; 0
            where these add much more than the quietest read.
    """

    mean: np.ndarray
    pressed: np.ndarray
    similarity: float | None
    growth: np.ndarray


def find_quiet(
    hand: OpenHand, frames: list[np.ndarray], label: np.ndarray, session: np.ndarray, *, sigmas: float
) -> Quiet:
    """The quietest frames of each recording.

    Args:
        frames: indices of the frames of each recording.
        label, session: (R,) index of its object and session.
        sigmas: standard deviations above the baseline of a sensor in contact.
    """
    mean, growth = np.empty((len(frames), hand.counts.shape[1])), np.zeros(len(frames))
    for row, index in enumerate(frames):
        counts = hand.counts[index].astype(np.float64)
        start = quietest(counts)
        mean[row] = counts[start : start + MIN_FRAMES].mean(axis=0)
        growth[row] = _growth(counts, mean[row])
    rest = np.empty_like(mean)
    for number in np.unique(session):
        of_session = session == number
        rest[of_session] = mean[of_session] - np.median(mean[of_session], axis=0)
    pressed = (np.abs(rest) > sigmas * hand.noise[session]).sum(axis=1)
    return Quiet(mean, pressed, _similarity(rest, label, session), growth)


def all_in_contact(quiet: Quiet, opened: np.ndarray, contact: np.ndarray, *, sensors: int) -> bool:
    """Whether even the quietest frames of the recordings are contact.

    They are if a recording has hardly any frames like them, or none unlike them; if a firmer grip presses the sensors
    more that they press already; or if they differ between recordings by as much as contact, and less so between
    recordings of one object, which a drifting baseline does not.

    Args:
        opened, contact: (R,) frames of the open hand and of contact, if the quietest are an open hand.
        sensors: fewest that are in contact in a frame of contact.
    """
    if np.median(opened) < MIN_FRAMES or np.median(contact) == 0:
        return True
    if np.median(quiet.growth) > max(GROWS, BY_CHANCE / np.sqrt(quiet.mean.shape[1])):
        return True
    return np.median(quiet.pressed) >= sensors and quiet.similarity is not None and quiet.similarity > ALIKE


def _growth(counts: np.ndarray, quiet: np.ndarray) -> float:
    """See `Quiet`; of counts (n, S) of a recording and its quietest frames (S,)."""
    activity = counts.sum(axis=1)
    active = np.argsort(activity, kind="stable")[-max(2, round(MOST_ACTIVE * len(counts))) :]
    added = counts[active].mean(axis=0) - quiet
    if not added.std() or quiet.std() < COMPARABLE * added.std():
        return 0.0
    return float(np.corrcoef(quiet, added)[0, 1])


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
