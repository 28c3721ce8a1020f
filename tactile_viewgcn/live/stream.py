"""A live stream: frames are pushed as they come, and each push returns what has changed."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tactile_viewgcn.tables.plan import Plan

LONGEST = 2000  # frames of a grasp

State = Literal["waiting", "ready", "contact", "answer", "final"]


@dataclass(frozen=True, eq=False)
class Update:
    """What a frame has changed.

    Attributes:
        state: `waiting` for an open hand; `ready`, the hand is open; `contact`, a grasp has begun;
            `answer` to the grasp so far; `final`, the answer to the whole grasp.
        frame: number of the frame that brought it, from 0.
        time: of that frame, as it was pushed; None without times.
        object: the most probable class; None without an answer.
        probability: of that class; None without an answer.
        probabilities: float32 (classes,); None without an answer.
        frames: number of frames of the grasp in contact so far.
        seconds: from the first of these to the last; None without times.
        note: why there is no answer, or why the grasp ended early; else "".
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


class LiveStream:
    """Answers a stream of frames; made by `Recogniser.stream` and `TactileClassifier.stream`.

    Args:
        plan: of the training.
        classes: names.
        answer: see `Recogniser.stream`.
        sure: the probability that closes a grasp early; None for never.
        longest: frames of a grasp, after which it is closed.
        every: an answer so far is given at most every so many frames.
    """

    def __init__(
        self,
        plan: Plan,
        classes: list[str],
        answer: Any,
        *,
        sure: float | None = None,
        longest: int = LONGEST,
        every: int = 1,
    ):
        self.plan = plan

    def push(self, frames: Any, time: Any = None, *, answer: bool = True) -> list[Update]:
        """Take one frame or several, and return what they have changed.

        Args:
            frames: (rows, columns) or (channels,), or (n, ...) of several.
            time: of the frame in seconds, or (n,).
            answer: False: answers so far are skipped; states and final answers come all the same.

        Raises:
            UserError: another shape, or readings that are not finite; none of them is taken.
        """
        raise NotImplementedError

    def close(self) -> list[Update]:
        """End the input, and return the final answer of an open grasp; then begin anew."""
        raise NotImplementedError
