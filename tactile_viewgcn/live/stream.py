"""A live stream: frames are pushed as they come, and each push returns what has changed."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np

from tactile_viewgcn.live.hand import Hand, hand_of
from tactile_viewgcn.messages import UserError, several
from tactile_viewgcn.readers.source import first_unfit, limits, storage_type
from tactile_viewgcn.tables.plan import Plan

LONGEST = 2000  # frames in contact after which a grasp is closed

State = Literal["waiting", "ready", "contact", "answer", "final"]


@dataclass(frozen=True, eq=False)
class Update:
    """What a frame has changed.

    Attributes:
        state: `waiting` for an open hand; `ready` for a grasp; `contact` when a grasp has begun;
            `answer` for an answer to the grasp so far; `final` for the answer to the whole grasp.
        frame: number of the frame that brought the update, from 0.
        time: time of this frame, as it was pushed; None without times.
        object: the most probable class; None without an answer.
        probability: probability of this class; None without an answer.
        probabilities: float32 (classes,); None without an answer.
        frames: number of the grasp's frames in contact so far.
        seconds: from the frame that began the grasp to the last frame in contact; None without
            times.
        note: why there is or will be no answer, or why the grasp was closed; else "".
    """

    state: State
    frame: int
    time: float | None = None
    object: str | None = None
    probability: float | None = None
    probabilities: np.ndarray | None = None
    frames: int = 0
    seconds: float | None = None
    note: str = ""


class Grasp(Protocol):
    """The frames in contact of an open grasp, see `recognition/growing.py`."""

    def __len__(self) -> int: ...

    def add(self, counts: np.ndarray, mean: np.ndarray) -> None:
        """Add a frame (H, W) in contact, and its baseline (H, W)."""

    def answer(self, *, is_last: bool) -> tuple[np.ndarray | None, str]:
        """Return the probabilities (classes,); or None, and why if no answer will follow."""


class LiveStream:
    """Answers frames as they come; made by `TactileClassifier.stream` and `Recogniser.stream`.

    A grasp begins and ends as `live/hand.py` says. No update depends on a later frame. `longest`
    bounds the memory and the time for a frame.

    Args:
        plan: of the training.
        classes: names of the classes.
        begin_grasp: returns a grasp without frames.
        open_hand_fault: returns what is wrong with a frame (H, W) of the open hand, or "".
        sure: an answer of this probability or more is final and closes the grasp early. With None
            no grasp is closed early.
        longest: a grasp is closed after this number of frames in contact.
        every: number of frames in contact from one provisional answer to the next.
        tare: whether the first five frames that read alike count as the open hand, whatever the
            open hand read in the training.

    Attributes:
        classes: see Args.
        skipped: number of answers that were due, but that `push` was told to skip.
        tare: whether any steady frames count as the open hand: see Args, or the plan subtracts a
            constant.

    Raises:
        UserError: an option is out of its range.
    """

    def __init__(
        self,
        plan: Plan,
        classes: list[str],
        begin_grasp: Callable[[], Grasp],
        open_hand_fault: Callable[[np.ndarray], str],
        *,
        sure: float | None = None,
        longest: int = LONGEST,
        every: int = 1,
        tare: bool = False,
    ):
        if sure is not None and not 0 < sure <= 1:
            raise UserError(f"sure is {sure}; expected a probability above 0, up to 1, or None")
        if longest < 1 or every < 1:
            raise UserError(f"longest is {longest}, every is {every}; expected 1 or more frames")
        self.classes = classes
        self.skipped = 0
        self._plan = plan
        self._dtype = np.dtype(np.float64)
        if np.dtype(plan.dtype).kind == "i":
            self._dtype = np.dtype(plan.dtype)
        self._begin_grasp = begin_grasp
        self._open_hand_fault = open_hand_fault
        self._sure = sure
        self._longest = longest
        self._every = every
        self.tare = tare or plan.params.baseline == "none"
        self._hand: Hand | None = None  # before the first frame
        self._state = ""  # of the hand, as the last update told it
        self._frame = -1  # number of the last frame
        self._time: float | None = None  # of the last frame
        self._waited = 0  # frames since a grasp was closed early
        self._grasp: Grasp | None = None
        self._since_answer = 0  # frames in contact
        self._began: float | None = None  # time of the frame that began the grasp
        self._last: float | None = None  # time of the last frame in contact
        self._is_noted = False  # whether an update said why the grasp has no answer

    def push(self, frames: Any, time: Any = None, *, answer: bool = True) -> list[Update]:
        """Take one frame or several, and return what they have changed.

        Args:
            frames: one frame (rows, columns) or (channels,), or n frames (n, ...).
            time: time of the frame in seconds, or n times (n,).
            answer: False skips provisional answers; states and final answers still come.

        Raises:
            UserError: the shape is another, a reading does not fit into the training's type, or a
                time is no finite number. Then no frame is taken.
        """
        taken = self._checked(frames)
        times = self._times(time, len(taken))
        updates = list[Update]()
        for counts, moment in zip(taken, times, strict=True):
            updates += self._follow(counts, moment, answer=answer)
        return updates

    def check(self, frames: Any) -> None:
        """Raise the UserError that `push` raises for frames, and take none of them.

        Args:
            frames: see `push`.
        """
        self._checked(frames)

    def close(self) -> list[Update]:
        """End the input, and return the final answer to an open grasp.

        Call it between two recordings. The next frame is the first frame of a new recording.
        """
        updates = list[Update]()
        if self._grasp is not None:
            updates.append(self._close_grasp("the input ended in the grasp"))
        self._hand = None
        self._state = ""
        return updates

    def _checked(self, frames: Any) -> np.ndarray:
        """Return a copy of frames (n, H, W) in the type of the plan."""
        where = f"frame {self._frame + 1}"
        try:
            array = np.asarray(frames)
        except ValueError:
            raise UserError(f"{where} is ragged; expected {self._expected()}") from None
        storage_type(array.dtype, where)
        height, width = self._plan.live.shape
        if height == 1 and array.ndim in (1, 2) and array.shape[-1] == width:
            array = array.reshape(-1, 1, width)
        if array.shape == (height, width):
            array = array[None]
        if array.shape[1:] != (height, width):
            raise UserError(f"{where} has shape {array.shape}; expected {self._expected()}")
        always_fits = array.dtype == self._dtype and self._dtype.kind == "i"
        if not always_fits:
            self._require_fit(array)
        return array.astype(self._dtype)  # a copy, since the caller can reuse the array

    def _require_fit(self, array: np.ndarray) -> None:
        """Raise a UserError if a reading (n, H, W) does not fit into the type of the plan."""
        low, high = limits("pressure", self._dtype)
        is_whole = self._dtype.kind == "i"
        row = first_unfit(array, low, high, is_whole=is_whole)
        if row is None:
            return
        readings = array[row].ravel()
        index = first_unfit(readings, low, high, is_whole=is_whole)
        assert index is not None
        expected = f"numbers from {low:g} to {high:g}"
        if is_whole:
            expected = f"whole {expected}, raw counts as in the training"
        raise UserError(
            f"frame {self._frame + 1 + row}: {self._sensor(index)} reads {readings[index]:g}; "
            f"expected {expected}"
        )

    def _sensor(self, index: int) -> str:
        """Return the name or the place of a sensor, in words."""
        if self._plan.channel_names:
            return f"sensor {self._plan.channel_names[index]}"
        height, width = self._plan.live.shape
        if height == 1:
            return f"sensor {index + 1}"
        return f"the sensor in row {index // width + 1}, column {index % width + 1}"

    def _expected(self) -> str:
        """Return in words the shapes that a frame can have."""
        height, width = self._plan.live.shape
        if height == 1:
            return f"({width},), or (frames, {width}), as in the training"
        return f"({height}, {width}), or (frames, {height}, {width}), as in the training"

    def _times(self, time: Any, count: int) -> list[float | None]:
        """Return the time of each frame."""
        if time is None:
            return [None] * count
        try:
            times = np.atleast_1d(np.asarray(time, dtype=np.float64))
        except (TypeError, ValueError, OverflowError):
            raise UserError(
                f"time is {time!r}; expected seconds, a number for each frame"
            ) from None
        if times.shape != (count,):
            raise UserError(f"time has shape {times.shape}; expected ({count},), one a frame")
        if not np.isfinite(times).all():
            raise UserError(f"time is {time!r}; expected finite seconds, or None without times")
        listed: list[float | None] = times.tolist()
        return listed

    def _follow(self, counts: np.ndarray, time: float | None, *, answer: bool) -> list[Update]:
        """Take a frame (H, W), and return what it has changed."""
        self._frame += 1
        self._time = time
        if self._hand is None:
            self._hand = hand_of(self._plan, counts, tare=self.tare)
        hand = self._hand
        in_contact = hand.follow(counts)
        updates = list[Update]()
        if self._grasp is not None and hand.state != "contact":
            updates.append(self._close_grasp())
        if hand.state == "contact":
            updates += self._hold(hand, in_contact, answer=answer)
        elif hand.state == "waiting":
            self._waited += 1
            if self._waited == self._longest:  # the baseline may have drifted
                hand.begin_anew()
        if hand.state not in ("contact", self._state):
            self._waited = 0
            note = ""
            if hand.state == "ready":
                note = self._open_hand_fault(counts)
            updates.append(Update(hand.state, self._frame, time, note=note))
        self._state = hand.state
        return updates

    def _hold(self, hand: Hand, in_contact: list[np.ndarray], *, answer: bool) -> list[Update]:
        """Add frames in contact to the grasp, and return what they have changed."""
        updates = list[Update]()
        begins = self._grasp is None
        grasp = self._grasp or self._begin_grasp()
        room = self._longest - len(grasp)
        for counts in in_contact[:room]:
            grasp.add(counts, hand.mean)
        if in_contact:
            self._last = self._time
        if begins:
            self._grasp = grasp
            self._began = self._time
            self._since_answer = self._every
            updates.append(self._update("contact"))
        elif in_contact:
            self._since_answer += 1
        if len(grasp) >= self._longest:
            note = f"closed with {several(len(grasp), 'frame')}, the most that are kept"
            updates.append(self._close_grasp(note))
            hand.begin_anew()
            if in_contact[room:] and hand.state == "ready":  # every frame counts as contact
                hand.state = "contact"
                updates += self._hold(hand, in_contact[room:], answer=answer)
        elif in_contact and self._since_answer >= self._every:
            updates += self._answer_so_far(hand, wanted=answer)
        return updates

    def _answer_so_far(self, hand: Hand, *, wanted: bool) -> list[Update]:
        """Return the answer to the frames so far; if it is sure enough, it closes the grasp."""
        if not wanted:
            self.skipped += 1
            return []
        assert self._grasp is not None
        self._since_answer = 0
        probabilities, note = self._grasp.answer(is_last=False)
        if probabilities is None:
            if not note or self._is_noted:
                return []
            self._is_noted = True
            return [self._update("contact", note=note)]
        if self._sure is None or probabilities.max() < self._sure:
            return [self._update("answer", probabilities)]
        final = self._close_grasp("closed early")
        hand.let_go()
        return [final]

    def _close_grasp(self, note: str = "") -> Update:
        """Close the grasp, and return the final answer to it."""
        assert self._grasp is not None
        probabilities, fault = self._grasp.answer(is_last=True)
        final = self._update("final", probabilities, note=fault or note)
        self._grasp = None
        self._is_noted = False
        return final

    def _update(
        self, state: State, probabilities: np.ndarray | None = None, *, note: str = ""
    ) -> Update:
        """Return an update on the open grasp."""
        assert self._grasp is not None
        seconds = None
        if self._began is not None and self._last is not None:
            seconds = self._last - self._began
        best: str | None = None
        probability: float | None = None
        if probabilities is not None:
            index = int(probabilities.argmax())
            best = self.classes[index]
            probability = float(probabilities[index])
        return Update(
            state,
            self._frame,
            self._time,
            best,
            probability,
            probabilities,
            len(self._grasp),
            seconds,
            note,
        )
