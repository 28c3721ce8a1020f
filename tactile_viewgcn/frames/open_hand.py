"""The open hand: frames in which nothing is touched, detected even where the baseline drifts.

A baseline that a whole session shares shows contact everywhere once it has drifted by more than the
signal. So each recording begins with its quietest frames, and the baseline follows the open hand
from there. It stands still during a grasp, as in a capacitive touch sensor.

It fails, and nothing says so,

- where a recording has no five successive frames without contact, and its session no empty hand: a
  light grip is then taken for the open hand, and only what presses more than it is contact;
- where sensors jump by more than five standard deviations of their noise between two frames, or
  drift by more than a third of one a frame: that is taken for contact, to the end of the recording;
- where what is held from the first frame to the last presses more than three quarters of the
  sensors: that is taken for drift, even beside an empty hand.

A flag of the source that an object is held always counts as contact.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import minimum_filter1d

from tactile_viewgcn.params import CONTACT_SIGMAS
from tactile_viewgcn.tables.counts import Counts
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

Moments = tuple[np.ndarray | None, np.ndarray]  # mean and noise
MIN_FRAMES = 5  # for a mean
# most sensors of an open hand that read contact: one may be faulty; none where one is contact
OPEN_SENSORS = 1
# of the threshold: a hand that closes, or holds little, presses several sensors a little
WEAK = 0.6
# most sensors of an open hand above that: two and a hundredth of all
WEAK_SENSORS, WEAK_SHARE = 2, 0.01
# frames this near to a touch do not count as open: the hand is closing, or has just let go
MARGIN = 2
# share of the difference between an open-hand frame and the baseline that the baseline follows
FOLLOWED = 0.1
UNMOVED = 0.25  # share of the sensors that a dense grasp leaves as they are, and drift does not
# enough to estimate what all sensors share, in a fifth of the time that 548 take
COMMON_SENSORS = 100


@dataclass(frozen=True)
class HandStates:
    """Which of T frames are without contact, and what that is computed from.

    Attributes:
        counts: (T, S) of the live sensors, an array or read from the recordings' file when indexed.
        noise: (sessions, S) standard deviation in counts, see `visible_noise`.
        contact: bool (T,) enough sensors are in contact, or a flag of the source says that an
            object is held.
        open: bool (T,) the hand is open in this frame and in the two before and after it: at most
            one sensor is in contact, few reach three fifths of that, and no flag says that an
            object is held. In other frames the hand is closing or opening, or presses weakly.
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
        """Whether even the quietest frames are contact, so that no open hand gives a baseline."""
        return bool(self.contact.all())

    def as_all_contact(self) -> "HandStates":
        """Return the same states, but every frame is in contact and none of the open hand."""
        contact = np.ones_like(self.contact)
        return replace(self, contact=contact, open=np.zeros_like(self.open))


def hand_states(
    recordings: Recordings,
    contact_sensors: int,
    moments: list[Moments],
    *,
    all_contact: bool = False,
) -> HandStates:
    """Find the frames of contact and those of the open hand.

    Args:
        contact_sensors: fewest sensors that are pressed in a frame of contact.
        moments: of each session, see `session_moments`.
        all_contact: look for no open hand: every frame counts as contact, and the quietest frames
            are not known.
    """
    counts, noises = recordings.live_counts(), np.stack([noise for _, noise in moments])
    contact, opened, quiet = (
        np.full(len(counts), all_contact),
        np.zeros(len(counts), dtype=bool),
        [],
    )
    flags = [
        recordings.columns[name] for name in ("valid", "grasp_valid") if name in recordings.columns
    ]
    flagged = np.any([opened, *flags], axis=0) & ~recordings.empty_hand
    for index in [] if all_contact else frames_by_recording(recordings):
        empty, noise = moments[recordings.columns["session"][index[0]]]
        of_recording = counts[index].astype(np.float64)
        pressed, still, start = _pressed(
            of_recording, CONTACT_SIGMAS * noise, contact_sensors, empty
        )
        contact[index] = (pressed >= contact_sensors) | flagged[index]
        opened[index] = minimum_filter1d(still & ~contact[index], 2 * MARGIN + 1, mode="nearest")
        quiet.append(of_recording[start : start + MIN_FRAMES].mean(axis=0))
    return HandStates(counts, noises, contact, opened, np.array(quiet))


def _pressed(
    counts: np.ndarray, threshold: np.ndarray, sensors: int, empty: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, int]:
    """Number of sensors (n,) in contact in each frame (n, S) of a recording, whether it seems open
    (n,), and the index of the first of its quietest frames.

    `threshold` (S,) is the least that a sensor in contact reads above the baseline, `empty` (S,)
    the session's empty hand. Frames that fall below the baseline by as much as contact show that
    the hand was not open where it began: then the frames with the smallest sums are tried, without
    leaving out what all sensors share, as a dense grasp is shared.
    """
    results = []
    for start in dict.fromkeys((quietest(counts), quietest(counts, common=False))):
        quiet = counts[start : start + MIN_FRAMES].mean(axis=0)
        begin, baseline = start, quiet
        if empty is not None and is_contact(quiet - empty, threshold, sensors):
            begin, baseline = 0, empty
        pressed, still, fallen = _follow(counts, begin, baseline, threshold, sensors)
        results.append((fallen, pressed, still, start))
        if not fallen:
            break
    return min(results, key=lambda result: result[0])[1:]


def _follow(
    counts: np.ndarray, start: int, baseline: np.ndarray, threshold: np.ndarray, sensors: int
) -> tuple[np.ndarray, np.ndarray, int]:
    """As `_pressed`, but the number of frames in which the baseline is too high instead of the quietest frames.

    The `baseline` (S,) follows the open hand from the frame `start` forwards, and from there
    backwards.
    """
    pressed, still, fallen = (
        np.zeros(len(counts), dtype=np.int64),
        np.zeros(len(counts), dtype=bool),
        0,
    )
    weak, most_weak = WEAK * threshold, WEAK_SENSORS + WEAK_SHARE * len(threshold)
    most_pressed = min(OPEN_SENSORS, sensors - 1)
    for numbers in (range(start, len(counts)), range(start - 1, -1, -1)):
        following = baseline.copy()
        for number in numbers:
            excess = counts[number] - following
            pressed[number] = np.count_nonzero(excess > threshold)
            fallen += int(np.count_nonzero(excess < -threshold) >= sensors)
            still[number] = (
                pressed[number] <= most_pressed and np.count_nonzero(excess > weak) <= most_weak
            )
            if still[number]:
                following += FOLLOWED * excess
    return pressed, still, fallen


def quietest(counts: np.ndarray, *, common: bool = True) -> int:
    """Index of the first of the five successive frames of counts (n, S) that read least.

    With `common`, what all sensors share is left out.
    """
    excess = counts - counts.mean(axis=0)
    activity = excess.sum(axis=1)
    if common:
        activity -= excess.shape[1] * np.median(
            excess[:, :: max(1, excess.shape[1] // COMMON_SENSORS)], axis=1
        )
    return int(np.convolve(activity, np.ones(min(MIN_FRAMES, len(counts))), "valid").argmin())


def is_contact(excess: np.ndarray, threshold: np.ndarray, sensors: int = 2) -> bool:
    """Whether an excess (S,) over the empty hand is contact and not drift.

    Drift moves all sensors together, or some up and some down. Contact moves less than half, all of
    them up; or more, and leaves a quarter where they are. A single sensor shows no difference: what
    it reads above is contact.

    Args:
        sensors: fewest sensors that are pressed in a frame of contact.
    """
    if len(excess) == 1:
        return bool(excess[0] > threshold[0])
    both = np.stack([excess, excess - np.median(excess)])
    up, down = (both > threshold).sum(axis=1), (both < -threshold).sum(axis=1)
    most_pressed = min(OPEN_SENSORS, sensors - 1)
    dense = up[0] > most_pressed and not down[0] and up[0] <= (1 - UNMOVED) * len(excess)
    return bool(dense or (up > most_pressed + 2 * down).all())
