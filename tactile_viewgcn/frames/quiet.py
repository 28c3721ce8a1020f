"""The quietest frames of each recording: an open hand, or contact as all the others?"""

import numpy as np

from tactile_viewgcn.frames.baseline import MIN_FRAMES
from tactile_viewgcn.frames.open_hand import OpenHand, quietest

MOST_ACTIVE = 0.2  # share of a recording's frames that are compared with its quietest
ALIKE = 0.2  # by so much two recordings of one object are more alike than those of two objects: a cosine
GROWS = 0.25  # correlation over sensors of what the quietest frames read with what is added to it
BY_CHANCE = 5.0  # so many standard deviations of that correlation of two random patterns
COMPARABLE = 0.5  # spread over the sensors of the quietest frames, in spreads of what is added to them


def quiet_means(hand: OpenHand, frames_of: list[np.ndarray]) -> np.ndarray:
    """Mean (R, S) over the five quietest successive frames of each recording, in counts.

    Args:
        frames_of: indices of the frames of each recording.
    """
    mean = np.empty((len(frames_of), hand.counts.shape[1]))
    for row, index in enumerate(frames_of):
        counts = hand.counts[index].astype(np.float64)
        start = quietest(counts)
        mean[row] = counts[start : start + MIN_FRAMES].mean(axis=0)
    return mean


def all_in_contact(
    hand: OpenHand,
    frames_of: list[np.ndarray],
    quiet: np.ndarray,
    *,
    label: np.ndarray,
    session: np.ndarray,
    sensors: int,
    sigmas: float,
) -> bool:
    """Whether even the quietest frames of the recordings are contact.

    They are if a recording has hardly any frames like them, or none unlike them; if a firmer grip presses the sensors
    more that they press already; or if they differ between recordings by as much as contact, and less so between
    recordings of one object, which a drifting baseline does not.

    Args:
        frames_of, quiet: see `quiet_means`, and what it returns.
        label, session: (R,) index of each recording's object and session.
        sensors, sigmas: what contact is, see `find_open_hand`.
    """
    opened, contact = (np.median([mask[index].sum() for index in frames_of]) for mask in (hand.open, hand.contact))
    if opened < MIN_FRAMES or contact == 0:
        return True
    growth = [
        _growth(hand.counts[index].astype(np.float64), mean) for index, mean in zip(frames_of, quiet, strict=True)
    ]
    if np.median(growth) > max(GROWS, BY_CHANCE / np.sqrt(quiet.shape[1])):
        return True
    difference = np.empty_like(quiet)  # from the session's median recording
    for number in np.unique(session):
        of_session = session == number
        difference[of_session] = quiet[of_session] - np.median(quiet[of_session], axis=0)
    pressed = (np.abs(difference) > sigmas * hand.noise[session]).sum(axis=1)
    return bool(np.median(pressed) >= sensors) and _similarity(difference, label, session) > ALIKE


def _growth(counts: np.ndarray, quiet: np.ndarray) -> float:
    """Correlation over the sensors of a recording's quietest frames with what its most active ones add to them.

    It is 0 where these add much more than the quietest read.

    Args:
        counts: (n, S) of the recording; quiet: (S,).
    """
    activity = counts.sum(axis=1)
    active = np.argsort(activity, kind="stable")[-max(2, round(MOST_ACTIVE * len(counts))) :]
    added = counts[active].mean(axis=0) - quiet
    if not added.std() or quiet.std() < COMPARABLE * added.std():
        return 0.0
    return float(np.corrcoef(quiet, added)[0, 1])


def _similarity(difference: np.ndarray, label: np.ndarray, session: np.ndarray) -> float:
    """Mean cosine of two recordings of one object, less that of two objects; 0 where no object has two recordings.

    Pairs in two sessions count if there are some: drift does not come again.

    Args:
        difference: (R, S); label, session: (R,).
    """
    centred = difference - difference.mean(axis=1, keepdims=True)
    length = np.linalg.norm(centred, axis=1, keepdims=True)
    unit = centred / np.where(length > 0, length, 1)
    cosine, same = unit @ unit.T, label[:, None] == label
    apart = session[:, None] != session
    pairs = same & apart if (same & apart).any() else same & ~np.eye(len(label), dtype=bool)
    if not pairs.any() or same.all():
        return 0.0
    return float(cosine[pairs].mean() - cosine[~same].mean())
