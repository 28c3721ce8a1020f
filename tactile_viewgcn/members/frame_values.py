"""Frames as the members read them: scaled and answered once, then used many times."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

MOST_FRAMES = 20_000  # most frames of a recording that are read


@dataclass(frozen=True)
class FrameValues:
    """The values of frames that members read, indexed by frames like an array.

    Attributes:
        readings: float32 (..., S), scaled readings of the live sensors.
        answers: the answers float32 (..., classes) to each frame, by the name of each member that
            answers single frames.
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
        """Return the number of values of a frame."""
        width: int = self.readings.shape[-1]
        for answer in self.answers.values():
            width += answer.shape[-1]
        return width


def every_few(frames: Any) -> Any:
    """Return the frames of a recording; above 20,000 frames, only every second, third and so on.

    Args:
        frames: (T, ...), an array or `FrameValues`.
    """
    step = -(-len(frames) // MOST_FRAMES)
    return frames[::step]
