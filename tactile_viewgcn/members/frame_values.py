"""Frames as the members read them: scaled once, answered one by one once, then used many times."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

MOST_FRAMES = 20_000  # of a recording that are read


@dataclass(frozen=True)
class FrameValues:
    """What the members read of frames. It is indexed by frames, as an array is.

    Attributes:
        readings: float32 (..., S), scaled readings of the live sensors.
        answers: the answers float32 (..., classes) to each frame, by the names of the members that
            answer single frames.
    """

    readings: np.ndarray
    answers: dict[str, np.ndarray]

    @classmethod
    def concatenated(cls, parts: Sequence[Self]) -> Self:
        """Return the frames of several parts, one after another."""
        readings = np.concatenate([part.readings for part in parts])
        answers = {}
        for name in parts[0].answers:
            answers[name] = np.concatenate([part.answers[name] for part in parts])
        return cls(readings, answers)

    def __len__(self) -> int:
        return len(self.readings)

    def __getitem__(self, index: Any) -> "FrameValues":
        answers = {name: answer[index] for name, answer in self.answers.items()}
        return FrameValues(self.readings[index], answers)

    @property
    def width(self) -> int:
        """The number of values that a frame has."""
        width: int = self.readings.shape[-1]
        for answer in self.answers.values():
            width += answer.shape[-1]
        return width


def every_few(frames: Any) -> Any:
    """Return the frames of a recording; of more than 20,000 every second, third or further one.

    Args:
        frames: (T, ...), an array or `FrameValues`.
    """
    step = -(-len(frames) // MOST_FRAMES)
    return frames[::step]
