"""When recordings are contact: how many sensors are pressed, what they read at least, and whether a hand ever opens."""

import math

import numpy as np

from tactile_viewgcn.frames.baseline import MIN_FRAMES, has_empty_hand
from tactile_viewgcn.frames.open_hand import OpenHand, frames_by_recording
from tactile_viewgcn.frames.quick_error import quick_error
from tactile_viewgcn.params import CONTACT_SIGMAS
from tactile_viewgcn.tables.recordings import Recordings

SENSORS_IN_CONTACT = 14  # of a frame of contact, of STAG's 548
CONTACT_SHARE = 1 / 40  # of the sensors of a smaller array: as STAG's 14
NEAR_ZERO = 0.05  # of the range of readings
SAMPLE = 2000  # frames whose readings are compared


def sensors_in_contact(live: int) -> int:
    """Fewest sensors that are pressed in a frame of contact: 14 of STAG's 548, a fortieth of a smaller array's."""
    return min(SENSORS_IN_CONTACT, max(2, math.ceil(CONTACT_SHARE * live)))


def smallest_reading(hand: OpenHand, usable: np.ndarray) -> float:
    """The smallest reading in usable frames (T,), in counts, to three digits; 0 where that is near it."""
    index = np.flatnonzero(usable)
    low, high = np.percentile(hand.counts[index[:: max(1, len(index) // SAMPLE)]], [0.1, 99])
    return 0.0 if abs(low) <= NEAR_ZERO * (high - low) else float(f"{low:.3g}")


def quietest_are_contact(recordings: Recordings, hand: OpenHand, training: np.ndarray) -> bool:
    """Whether even the quietest frames are contact, so that there is no open hand to take a baseline from.

    Without an empty hand in every session they are if hardly any frame is as quiet, or none reads more; or if they
    differ between recordings by as much as contact, and predict the objects of the training side. Drift alone does not
    predict them: sessions are held out where they can be, as it never comes again.

    Args:
        training: bool (T,) frames whose objects may be looked at: of a recording whose quietest frames are among them.
    """
    if has_empty_hand(recordings):
        return False
    recorded = frames_by_recording(recordings)
    opened, contact = ([mask[index].sum() for index in recorded] for mask in (hand.open, hand.contact))
    if np.median(opened) < MIN_FRAMES or np.median(contact) == 0:
        return True
    quietest = np.array([index[0] for index in hand.quietest])
    usable = np.array([training[index].all() for index in hand.quietest])
    label, session = recordings.columns["object"][quietest], recordings.columns["session"][quietest]
    difference = hand.quiet - session_medians(hand.quiet, session)
    pressed = (np.abs(difference) > CONTACT_SIGMAS * hand.noise[session]).sum(axis=1)
    if np.median(pressed) < hand.sensors:
        return False
    for group in (session, np.arange(len(label))):
        if error := quick_error("all contact", lambda index: difference[index], usable, label, group):
            return error.tells_object
    return False


def session_medians(values: np.ndarray, session: np.ndarray) -> np.ndarray:
    """Median (R, S) over the recordings of each one's session, of values (R, S)."""
    medians = np.empty_like(values)
    for number in np.unique(session):
        medians[session == number] = np.median(values[session == number], axis=0)
    return medians
