"""The open hand: frames in which nothing is touched, detected even if the baseline drifts.

A baseline that a whole session shares shows contact everywhere once it has drifted by more than the
signal. So each recording begins with its quietest frames, and the baseline follows the open hand
from there. It stands still during a grasp, as in a capacitive touch sensor.

The detection fails without a warning in five cases:

- A recording has no five successive frames without contact, and its session has no empty hand. Then
  a light grip is taken for the open hand, and only stronger pressure counts as contact.
- Several sensors jump between two frames, by about four standard deviations of their noise. Or they
  drift by more than about a tenth of a standard deviation a frame. After a rise the later frames
  count as contact. Before a fall the earlier frames do.
- An object that is held from the first frame to the last presses more than three quarters of the
  sensors, or about half of them hardly above the threshold. It is taken for drift, even if the
  session has an empty hand.
- An object that is held from the first frame to the last presses less than five standard deviations
  of the drift between known open hands. It is taken for drift too.
- In a whole recording, two sensors or more read higher than in the session's empty hand, compared
  with all other sensors and by more than the threshold. Then every frame counts as contact.

A frame that the source flags as holding an object always counts as contact.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter1d

from tactile_viewgcn.frames.drift import OPEN_SENSORS, WEAK, is_contact
from tactile_viewgcn.frames.moments import MIN_FRAMES, Moments
from tactile_viewgcn.params import CONTACT_SIGMAS
from tactile_viewgcn.tables.counts import Counts
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

# most sensors of an open hand with weak pressure: two, and a hundredth of all sensors
WEAK_SENSORS = 2
WEAK_SHARE = 0.01
# frames this near to a touch do not count as open: the hand is closing, or has just let go
MARGIN = 2
# share of the difference between an open-hand frame and the baseline that the baseline follows
FOLLOWED = 0.1
# enough sensors to estimate the signal that all share, in a fifth of the time that 548 take
COMMON_SENSORS = 100


@dataclass(frozen=True)
class HandStates:
    """The hand's state in each of T frames, and the measurements behind it.

    Attributes:
        counts: (T, S) of the live sensors. They are an array, or they are read from the recordings'
            file when they are indexed.
        noise: (sessions, S) standard deviation in counts within a recording, see `Moments`.
        contact: bool (T,), enough sensors are in contact, or a flag of the source says that an
            object is held.
        open: bool (T,), the hand is open in this frame and in the two frames before and after it.
            In an open hand at most one sensor is in contact. At most two sensors and a hundredth of
            all reach three fifths of the threshold of contact. No flag says that an object is held.
            In frames of neither kind the hand is closing or opening, or presses weakly.
        quiet: (R, S) mean in counts over the five quietest successive frames of each recording with
            frames.
    """

    counts: Counts
    noise: np.ndarray
    contact: np.ndarray
    open: np.ndarray
    quiet: np.ndarray

    @property
    def all_contact(self) -> bool:
        """Return whether every frame counts as contact, so that no open hand gives a baseline.

        That happens if even the quietest frames are contact, and after `as_all_contact`.
        """
        return bool(self.contact.all())

    def as_all_contact(self) -> "HandStates":
        """Return a copy in which every frame is in contact, and no frame shows an open hand."""
        contact = np.ones_like(self.contact)
        return replace(self, contact=contact, open=np.zeros_like(self.open))


class _Followed(NamedTuple):
    """The n frames of a recording, compared with a baseline that follows the open hand.

    Attributes:
        pressed: (n,) number of sensors in contact.
        still: bool (n,), the hand seems open.
        fallen: number of frames that fall below the baseline by as much as contact rises above it.
    """

    pressed: np.ndarray
    still: np.ndarray
    fallen: int


class _Tried(NamedTuple):
    """Five frames of a recording that were tried as its open hand.

    Attributes:
        followed: the recording's frames above a baseline that begins with these frames or, if they
            are contact, with the session's empty hand.
        start: index of the first of them.
        are_contact: whether they are contact compared with the session's empty hand.
    """

    followed: _Followed
    start: int
    are_contact: bool


def hand_states(
    recordings: Recordings,
    contact_sensors: int,
    moments: list[Moments],
    *,
    all_contact: bool = False,
) -> HandStates:
    """Return the frames of contact and the frames of the open hand.

    Args:
        recordings: T frames.
        contact_sensors: fewest sensors that are pressed in a frame of contact.
        moments: the moments of each session, see `session_moments`.
        all_contact: whether to skip the search for an open hand. Then every frame counts as
            contact, and the quietest frames are not known.
    """
    counts = recordings.live_counts()
    noise = np.stack([of_session.noise for of_session in moments])
    contact = np.full(len(counts), all_contact)
    opened = np.zeros(len(counts), dtype=bool)
    quiet = list[np.ndarray]()
    if all_contact:
        return HandStates(counts, noise, contact, opened, np.array(quiet))
    is_held = _flagged_as_held(recordings)
    for index in frames_by_recording(recordings):
        of_session = moments[recordings.columns["session"][index[0]]]
        of_recording = counts[index].astype(np.float64)
        tried = _find_open_hand(of_recording, of_session, contact_sensors)
        contact[index] = (tried.followed.pressed >= contact_sensors) | is_held[index]
        still = tried.followed.still & ~contact[index]
        opened[index] = minimum_filter1d(still, 2 * MARGIN + 1, mode="nearest")
        quiet.append(of_recording[tried.start : tried.start + MIN_FRAMES].mean(axis=0))
    return HandStates(counts, noise, contact, opened, np.array(quiet))


def _flagged_as_held(recordings: Recordings) -> np.ndarray:
    """Return the frames, bool (T,), in which a flag of the source says that an object is held."""
    is_held: np.ndarray = np.zeros(len(recordings), dtype=bool)
    for name in ("valid", "grasp_valid"):
        if name in recordings.columns:
            is_held |= recordings.columns[name]
    is_held[recordings.empty_hand] = False
    return is_held


def _find_open_hand(counts: np.ndarray, moments: Moments, sensors: int) -> _Tried:
    """Return the five frames that are taken for the open hand of a recording.

    The five quietest frames are tried first. If some frames fall below the baseline, or if the five
    are contact, the hand may have held something in them. Then the five frames with the smallest
    sums are tried too. The signal that all sensors share stays in these sums, because a dense grasp
    is shared too. Of the two, the try with fewer fallen frames is taken, then the one without
    contact.

    Args:
        counts: (n, S) of the recording.
        moments: the moments of the recording's session.
        sensors: fewest sensors in a frame of contact.
    """
    first = _try(counts, quietest(counts), moments, sensors)
    if first.followed.fallen == 0 and not first.are_contact:
        return first
    second = _try(counts, quietest(counts, common=False), moments, sensors)
    return min(first, second, key=lambda tried: (tried.followed.fallen, tried.are_contact))


def _try(counts: np.ndarray, start: int, moments: Moments, sensors: int) -> _Tried:
    """Return five frames of a recording, tried as its open hand.

    Args:
        counts: (n, S) of the recording.
        start: index of the first of the five frames.
        moments: the moments of the recording's session.
        sensors: fewest sensors in a frame of contact.
    """
    begin = start
    baseline = counts[start : start + MIN_FRAMES].mean(axis=0)
    are_contact = False
    if moments.mean is not None:
        of_drift = CONTACT_SIGMAS * moments.drifted_noise
        are_contact = is_contact(baseline - moments.mean, of_drift, sensors)
        if are_contact:
            begin = 0
            baseline = moments.mean
    followed = _follow(counts, begin, baseline, CONTACT_SIGMAS * moments.noise, sensors)
    return _Tried(followed, start, are_contact)


class Follower:
    """A baseline that follows the open hand from frame to frame, and stands still in a grasp.

    Args:
        baseline: (S,) counts before the first frame.
        threshold: (S,) the least excess over the baseline of a sensor in contact.
        sensors: fewest sensors in a frame of contact.

    Attributes:
        baseline: (S,) counts after the last frame.
        pressed: number of sensors in contact in the last frame.
        still: whether the hand seems open in the last frame.
        fallen: whether the last frame falls below the baseline by as much as contact rises above
            it.
    """

    def __init__(self, baseline: np.ndarray, threshold: np.ndarray, sensors: int):
        self.baseline = baseline.copy()
        self.pressed = 0
        self.still = False
        self.fallen = False
        self._threshold = threshold
        self._weak = WEAK * threshold
        self._sensors = sensors
        self._most_weak = most_weak_sensors(len(threshold))
        self._most_pressed = min(OPEN_SENSORS, sensors - 1)

    def follow(self, counts: np.ndarray) -> None:
        """Take the next frame (S,)."""
        excess = counts - self.baseline
        self.pressed = int(np.count_nonzero(excess > self._threshold))
        self.fallen = int(np.count_nonzero(excess < -self._threshold)) >= self._sensors
        self.still = False
        if self.pressed <= self._most_pressed:
            self.still = int(np.count_nonzero(excess > self._weak)) <= self._most_weak
        if self.still:
            self.baseline += FOLLOWED * excess


def most_weak_sensors(sensors: int) -> float:
    """Return how many of all sensors of an open hand can have weak pressure, see `WEAK`."""
    return WEAK_SENSORS + WEAK_SHARE * sensors


def _follow(
    counts: np.ndarray, start: int, baseline: np.ndarray, threshold: np.ndarray, sensors: int
) -> _Followed:
    """Return the frames of a recording above a baseline that follows the open hand.

    The baseline follows from the frame `start` forwards, and from there backwards.

    Args:
        counts: (n, S) of the recording.
        start: index of the frame in which the baseline is known.
        baseline: (S,) in that frame.
        threshold: (S,) the least excess over the baseline of a sensor in contact.
        sensors: fewest sensors in a frame of contact.
    """
    pressed = np.zeros(len(counts), dtype=np.int64)
    still = np.zeros(len(counts), dtype=bool)
    fallen = 0
    for frames in (range(start, len(counts)), range(start - 1, -1, -1)):
        follower = Follower(baseline, threshold, sensors)
        for frame in frames:
            follower.follow(counts[frame])
            pressed[frame] = follower.pressed
            still[frame] = follower.still
            fallen += int(follower.fallen)
    return _Followed(pressed, still, fallen)


def quietest(counts: np.ndarray, *, common: bool = True) -> int:
    """Return the index of the first of the five successive frames with the smallest readings.

    Args:
        counts: (n, S) of a recording.
        common: whether to leave out the signal that all sensors share.
    """
    excess = counts - counts.mean(axis=0)
    activity = excess.sum(axis=1)
    if common:
        step = max(1, excess.shape[1] // COMMON_SENSORS)
        activity -= excess.shape[1] * np.median(excess[:, ::step], axis=1)
    window = np.ones(min(MIN_FRAMES, len(counts)))
    return int(np.convolve(activity, window, "valid").argmin())
