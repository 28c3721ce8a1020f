"""The hand in a stream: it is waiting to be opened, ready for a grasp, or in contact.

This applies the plan of the training without looking ahead. `frames/apply.py` looks at a whole
recording; here each frame is judged by the frames before it:

- The baseline begins with the first five successive frames of an open hand. Such frames read alike,
  and show no contact above the last known open hand. At first, that is the mean of the training
  set's sessions, from which the stream may differ by their drift.
- The baseline then follows the open hand, as in `frames/open_hand.py`. The baseline of a grasp is
  the mean of the open-hand frames since the previous grasp, as in `apply`. The last 256 of these
  frames are kept.
- A grasp begins when enough sensors exceed the baseline by a threshold, which comes from the noise
  of the training set. It ends when the hand has been open for five successive frames.
- The baseline is given up after fifty frames that are neither in contact nor of an open hand. It is
  also given up after five frames below it, since the hand was then not open when it began. The
  stream then waits for an open hand.

If the training recordings show no open hand, the baseline of the training set is taken. A grasp
then ends after five successive frames without contact.

If the plan keeps every frame, nothing shows where a grasp begins and ends. All frames then belong
to one grasp until it is as long as the stream allows. The next frame begins the next grasp, above
the same baseline.
"""

from abc import ABC, abstractmethod
from collections import deque
from typing import Literal

import numpy as np

from tactile_viewgcn.frames.apply import keeps_every_frame, new_session_drift
from tactile_viewgcn.frames.drift import WEAK, is_contact
from tactile_viewgcn.frames.moments import (
    MIN_FRAMES,
    noise_of_changes,
    trimmed_moments,
    visible_noise,
)
from tactile_viewgcn.frames.open_hand import MARGIN, Follower, most_weak_sensors
from tactile_viewgcn.params import CONTACT_SIGMAS
from tactile_viewgcn.tables.plan import Plan

OPEN_FRAMES = 256  # a baseline is the mean of at most this number of open-hand frames
CLOSING = 16  # last frames of a closing hand, which can be in contact already
# after this number of frames neither in contact nor open, the stream looks for an open hand again
MOST_UNCLEAR = 50
NOISE_FRAMES = 32  # first frames, which show the noise if the training did not measure it

HandState = Literal["waiting", "ready", "contact"]


class Hand(ABC):
    """The hand's state after each frame of a stream.

    Attributes:
        state: `waiting` for an open hand, `ready` for a grasp, or in `contact`.
        mean: (H, W) baseline of the grasp in counts, valid in the state `contact`.
    """

    def __init__(self, state: HandState, mean: np.ndarray):
        self.state = state
        self.mean = mean

    @abstractmethod
    def follow(self, counts: np.ndarray) -> list[np.ndarray]:
        """Take the next frame (H, W), and return the frames that are now known to be in contact.

        The list is empty, or it has this frame. If a grasp begins, it can also have a few frames
        before this frame.
        """

    @abstractmethod
    def let_go(self) -> None:
        """Close the grasp early; the next begins after an open hand, if the plan knows one."""

    def begin_anew(self) -> None:
        """Close the grasp, and look for the open hand again, since the baseline may have drifted.

        If every frame counts as contact, nothing shows an open hand. The next frame then begins a
        grasp instead.
        """
        self.let_go()


def hand_of(plan: Plan, first: np.ndarray, *, tare: bool = False) -> Hand:
    """Return the hand of a stream before its first frame.

    Args:
        plan: of the training.
        first: counts (H, W) of the first frame; cells without a sensor keep this reading.
        tare: whether the first five frames that read alike count as the open hand, whatever the
            open hand read in the training set.
    """
    mean = first.astype(np.result_type(first.dtype, np.float32))
    mean[plan.live] = plan.mean_baseline()[plan.live]
    every_frame = keeps_every_frame(plan)
    if plan.params.baseline == "none":
        mean[:] = plan.params.zero
        if every_frame:
            return EveryFrame(mean)
        return OpenHand(plan, mean, tare=True)
    if plan.shows_open_hand:
        return OpenHand(plan, mean, tare=tare, every_frame=every_frame)
    if every_frame:
        return EveryFrame(mean)
    return KnownBaseline(plan, mean)


class EveryFrame(Hand):
    """A hand whose every frame counts as contact.

    Args:
        mean: (H, W) baseline in counts.
    """

    def __init__(self, mean: np.ndarray):
        super().__init__("ready", mean)

    def follow(self, counts: np.ndarray) -> list[np.ndarray]:
        """See `Hand.follow`."""
        self.state = "contact"
        return [counts]

    def let_go(self) -> None:
        """See `Hand.let_go`; the next frame begins the next grasp."""
        self.state = "ready"


class KnownBaseline(Hand):
    """A hand above the training set's baseline, for a training set without an open hand.

    Args:
        plan: of the training.
        mean: (H, W) baseline in counts.
    """

    def __init__(self, plan: Plan, mean: np.ndarray):
        super().__init__("ready", mean)
        self._live = plan.live
        self._limit = mean[plan.live] + CONTACT_SIGMAS * plan.noise[plan.live]
        self._sensors = int(plan.params.contact_sensors)
        self._without = 0  # successive frames without contact

    def follow(self, counts: np.ndarray) -> list[np.ndarray]:
        """See `Hand.follow`."""
        if np.count_nonzero(counts[self._live] > self._limit) < self._sensors:
            self._without += 1
            if self._without >= MIN_FRAMES:
                self.state = "ready"
            return []
        self._without = 0
        if self.state == "waiting":
            return []
        self.state = "contact"
        return [counts]

    def let_go(self) -> None:
        """See `Hand.let_go`."""
        self.state = "waiting"
        self._without = 0


class OpenHand(Hand):
    """A hand whose open frames give the baseline of each grasp.

    Args:
        plan: of the training. If it has no noise, the first 32 frames show the noise.
        mean: (H, W) counts of an open hand in the training. If the plan has no baseline, this is
            the constant that stands for it.
        tare: see `hand_of`.
        every_frame: whether all frames from the first open hand on count as contact.
    """

    def __init__(self, plan: Plan, mean: np.ndarray, *, tare: bool, every_frame: bool = False):
        super().__init__("waiting", mean)
        self._live = plan.live
        self._sensors = int(plan.params.contact_sensors)
        self._has_baseline = plan.params.baseline != "none"
        self._drift = new_session_drift(plan)  # of the first open hand from the training set's
        self._every_frame = every_frame
        self._open_hand: np.ndarray | None = None  # (S,) the last known open hand
        if not tare:
            self._open_hand = mean[plan.live]
        self._threshold: np.ndarray | None = None  # (S,) above the baseline
        if self._has_baseline:
            self._threshold = CONTACT_SIGMAS * plan.noise[plan.live]
        self._limit = np.zeros(0)  # (S,) a sensor above its limit is in contact, in a grasp
        self._follower: Follower | None = None  # None until an open hand is found
        self._first = deque[np.ndarray](maxlen=NOISE_FRAMES)  # (H, W) while there is no follower
        self._opened = deque[np.ndarray](maxlen=OPEN_FRAMES)  # (S,) of the open hand
        self._unknown = deque[np.ndarray](maxlen=CLOSING)  # (H, W) after the last open frame
        self._still = 0  # successive frames in which the hand seems open
        self._unclear = 0  # frames since the last frame in contact or of an open hand
        self._fallen = 0  # successive frames below the baseline

    def follow(self, counts: np.ndarray) -> list[np.ndarray]:
        """See `Hand.follow`."""
        if self._follower is None:
            return self._seek(counts)
        if self._every_frame:
            self.state = "contact"
            return [counts]
        values = counts[self._live]
        self._unknown.append(counts)
        self._follower.follow(values)
        self._still += 1
        if not self._follower.still:
            self._still = 0
        if self.state == "ready":
            return self._follow_open_hand(self._follower)
        if self.state == "contact" and self._in_contact(values):
            self._unclear = 0
            self._still = 0
            return [counts]
        self._unclear += 1
        if self._still >= MIN_FRAMES:
            self._opened.clear()
            self._take_open_frame()
            self.state = "ready"
            self._unclear = 0
        elif self.state == "contact" and self._unclear >= MOST_UNCLEAR:
            self.begin_anew()
        return []

    def let_go(self) -> None:
        """See `Hand.let_go`."""
        self.state = "waiting"
        self._still = 0
        if self._every_frame:
            self._forget_open_hand()

    def begin_anew(self) -> None:
        """See `Hand.begin_anew`."""
        if self._every_frame and self.state == "contact":
            self.state = "ready"
        elif self._follower is not None:  # without a follower the search is already under way
            self._forget_open_hand()

    def _forget_open_hand(self) -> None:
        """Wait for an open hand."""
        self.state = "waiting"
        self._follower = None
        self._first.clear()

    def _seek(self, counts: np.ndarray) -> list[np.ndarray]:
        """Take a frame (H, W) while an open hand is sought; get ready if the hand is open.

        If every frame counts as contact, the frames of the open hand are returned too.
        """
        self._first.append(counts)
        if self._threshold is None:
            if len(self._first) < NOISE_FRAMES:
                return []
            self._threshold = CONTACT_SIGMAS * self._noise_of_first()
        if len(self._first) < MIN_FRAMES:
            return []
        frames = list(self._first)[-MIN_FRAMES:]
        values = np.stack([frame[self._live] for frame in frames])
        mean = values.mean(axis=0, dtype=np.float64)
        if not self._is_open(values, mean, self._threshold):
            return []
        self._open_hand = mean
        self._drift = 0.0  # from here on, the open hand is the stream's own
        self._follower = Follower(mean, self._threshold, self._sensors)
        self._opened.clear()
        self._opened.extend(values[:-MARGIN])
        self._unknown.clear()
        self._unknown.extend(frames[-MARGIN:])
        self._still = MIN_FRAMES
        self._fallen = 0
        self._unclear = 0
        self.state = "ready"
        if not self._every_frame:
            return []
        self._begin_grasp()
        return frames

    def _noise_of_first(self) -> np.ndarray:
        """Return the noise (S,) of the first frames, from differences of successive frames."""
        values = np.stack([frame[self._live] for frame in self._first])
        return noise_of_changes(values[:-1], values[1:], visible_noise(values))

    def _is_open(self, values: np.ndarray, mean: np.ndarray, threshold: np.ndarray) -> bool:
        """Return whether five frames are of an open hand.

        Args:
            values: (5, S) counts.
            mean: (S,) their mean.
            threshold: (S,) a sensor in contact reads at least this much above the baseline.
        """
        is_unlike = np.abs(values - mean) > WEAK * threshold
        if np.count_nonzero(is_unlike, axis=1).max() > most_weak_sensors(len(threshold)):
            return False
        if self._open_hand is None:
            return True
        of_drift = np.hypot(threshold, CONTACT_SIGMAS * self._drift)
        return not is_contact(mean - self._open_hand, of_drift, self._sensors)

    def _follow_open_hand(self, follower: Follower) -> list[np.ndarray]:
        """Return the frames in contact, which begin a grasp, after a frame in the state `ready`."""
        self._unclear += 1
        if self._still >= MIN_FRAMES:
            self._unclear = 0
            self._take_open_frame()
        if follower.pressed < self._sensors:
            self._fallen += 1
            if not follower.fallen:
                self._fallen = 0
            # the hand was not open when the baseline began, or the sensors have drifted
            if self._fallen >= MIN_FRAMES or self._unclear >= MOST_UNCLEAR:
                self.begin_anew()
            return []
        self._fallen = 0
        self._begin_grasp()
        in_contact = [self._in_contact(frame[self._live]) for frame in self._unknown]
        if not in_contact[-1]:
            self.state = "ready"
            return []
        frames = [frame for frame, is_in in zip(self._unknown, in_contact, strict=True) if is_in]
        self._unknown.clear()
        return frames

    def _take_open_frame(self) -> None:
        """Count the frame before the last two as open, and forget the frames before it."""
        while len(self._unknown) > MARGIN:
            frame = self._unknown.popleft()
        self._opened.append(frame[self._live])

    def _begin_grasp(self) -> None:
        """Begin a grasp above the mean of the open hand's frames since the previous grasp."""
        if len(self._opened) >= MIN_FRAMES:
            self._open_hand, _ = trimmed_moments(np.stack(self._opened))
        assert self._open_hand is not None
        assert self._threshold is not None
        self._limit = self._open_hand + self._threshold
        if self._has_baseline:
            self.mean = self.mean.copy()
            self.mean[self._live] = self._open_hand
        self.state = "contact"
        self._unclear = 0

    def _in_contact(self, values: np.ndarray) -> bool:
        """Return whether enough sensors (S,) of a frame are in contact in the open grasp."""
        return int(np.count_nonzero(values > self._limit)) >= self._sensors
