"""Drift: by how much open hands differ, and how contact differs from it."""

import numpy as np

from tactile_viewgcn.params import CONTACT_SIGMAS

# most sensors of an open hand that read contact, since one can be faulty. If a single sensor is
# enough for contact, an open hand has none
OPEN_SENSORS = 1
# share of the threshold that counts as weak pressure: a hand that closes, or holds little, presses
# several sensors a little
WEAK = 0.6
# a dense grasp leaves this share of the sensors or more unmoved
UNMOVED = 0.25
DRIFT_STEP = 1.05  # factor from one drift that is tried to the next


def drift_between(means: np.ndarray) -> float:
    """Return by how much a sensor differs between open hands, as a standard deviation in counts.

    The median sensor is taken. A shift that all sensors share is left out, since it is never taken
    for contact. The drift of fewer than two open hands is 0.

    Args:
        means: (R, S) mean counts of each open hand.
    """
    if len(means) < 2:
        return 0.0
    unshared = means.astype(np.float64)
    if means.shape[1] > 1:
        unshared -= np.median(unshared, axis=1, keepdims=True)
    return float(np.median(np.std(unshared, axis=0, ddof=1)))


def is_contact(excess: np.ndarray, threshold: np.ndarray, sensors: int = 2) -> bool:
    """Return whether an excess over the empty hand is contact and not drift.

    Drift moves all sensors together, or some up and some down. Sparse contact raises less than half
    of the sensors. Dense contact raises up to three quarters of them and lowers none. At least a
    quarter of them stays well below the median, which shared drift does not do. If about half of
    the sensors are pressed, hardly more than the threshold, that is taken for drift. A single
    sensor cannot tell drift from contact, so any reading above the threshold is contact.

    Args:
        excess: (S,) in counts.
        threshold: (S,) the least excess over the empty hand of a sensor in contact.
        sensors: fewest sensors that are pressed in a frame of contact.
    """
    if len(excess) == 1:
        return bool(excess[0] > threshold[0])
    # with the signal that all sensors share, and without it
    both = np.stack([excess, excess - np.median(excess)])
    up = (both > threshold).sum(axis=1)
    down = (both < -threshold).sum(axis=1)
    most_pressed = min(OPEN_SENSORS, sensors - 1)
    is_sparse = (up > most_pressed + 2 * down).all()
    moves_up = up[0] > most_pressed and not down[0]
    unmoved = UNMOVED * len(excess)
    leaves_some = up[0] <= len(excess) - unmoved
    below_median = np.count_nonzero(both[1] < -WEAK * threshold)
    is_dense = moves_up and leaves_some and below_median >= unmoved
    return bool(is_dense or is_sparse)


def accepting_drift(means: np.ndarray, least: float, noise: np.ndarray, sensors: int) -> float:
    """Return a drift with which none of the training's sessions counts as contact, in counts.

    Each session's open hand is compared with the mean of the others, as the open hand of a new
    session is compared with the training set's. The drift of the median sensor does not suffice if
    a few sensors differ from session to session, such as those at a fold of a glove that is put on
    anew. Then it is raised in steps of a twentieth.

    Args:
        means: (R, S) mean counts of the open hand in each session.
        least: the drift of the median sensor in counts, which is returned if it suffices.
        noise: (S,) standard deviation in counts of an open hand about its own mean.
        sensors: fewest sensors that are pressed in a frame of contact.
    """
    if len(means) < 2:
        return least
    means = means.astype(np.float64)
    others = (means.sum(axis=0) - means) / (len(means) - 1)
    drift = least
    while any(
        is_contact(excess, CONTACT_SIGMAS * np.hypot(noise, drift), sensors)
        for excess in means - others
    ):
        drift = DRIFT_STEP * max(drift, float(noise.min()))
    return drift
