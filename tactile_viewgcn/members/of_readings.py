"""Base classes of members that turn the readings of several frames into one point to answer."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np

from tactile_viewgcn.members.estimators import Estimator, probabilities
from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.frame_values import FrameValues
from tactile_viewgcn.members.member import Member
from tactile_viewgcn.members.representation import Representation
from tactile_viewgcn.progress import steps


class MemberOfReadings(Member):
    """Base of the members that turn a whole recording into one point.

    Attributes:
        whole: the fitted estimator of whole recordings; None before `fit`.
    """

    def __init__(self, representation: Representation, classes: int):
        super().__init__(representation, classes)
        self.whole: Estimator | None = None

    @abstractmethod
    def estimator(self, *, quick: bool = False) -> Estimator:
        """Return the member's estimator, not fitted yet.

        Args:
            quick: whether fewer trees suffice.
        """

    @abstractmethod
    def recording_points(self, readings: np.ndarray) -> np.ndarray:
        """Return the points (B, F) of whole recordings.

        Args:
            readings: (B, T, S) in the order of time.
        """

    def fit(
        self, examples: Examples, recordings: np.ndarray, *, seed: int, quick: bool = False
    ) -> None:
        """See `Member.fit`."""
        points = examples.recording_points(self.name, self.recording_points)
        labels = examples.labels[recordings]
        self.whole = self.estimator(quick=quick).fit(points[recordings], labels, seed)

    def answer_examples(self, examples: Examples, recordings: np.ndarray) -> np.ndarray:
        """See `Member.answer_examples`."""
        points = examples.recording_points(self.name, self.recording_points)
        return self._answer_whole(points[recordings])

    def answer_recordings(self, frames: FrameValues) -> np.ndarray:
        """See `Member.answer_recordings`."""
        return self._answer_whole(self.recording_points(frames.readings))

    def state_dict(self) -> dict[str, Any]:
        """See `Member.state_dict`."""
        if self.whole is None:
            return {}
        return {"whole": self.whole.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """See `Member.load_state_dict`."""
        self.whole = self.estimator().load_state_dict(state["whole"])

    def _answer_whole(self, points: np.ndarray) -> np.ndarray:
        """Return the probabilities (B, classes) of whole recordings' points (B, F)."""
        if self.whole is None:
            raise ValueError(f"{self.name} is not fitted to whole recordings")
        return probabilities(self.whole, points, self.classes)


class MemberOfSets(MemberOfReadings):
    """Base of the members of readings that also answer view sets.

    View sets have separate estimators, one for each fitted number of frames. The estimator of the
    largest fitted number up to k answers a view set of k frames. A member can be fitted to view
    sets only.

    Attributes:
        sets: the fitted estimators of view sets, by number of frames.
    """

    answers_sets = True

    def __init__(self, representation: Representation, classes: int):
        super().__init__(representation, classes)
        self.sets: dict[int, Estimator] = {}

    @abstractmethod
    def set_points(self, readings: np.ndarray) -> np.ndarray:
        """Return the points (B, F) of view sets, which do not depend on the order of frames.

        Args:
            readings: (B, k, S).
        """

    def fit_sets(self, examples: Examples, *, seed: int) -> None:
        """See `Member.fit_sets`."""
        for size in steps(examples.sets, f"{self.name}, fits of view sets", "sizes"):
            readings, recording = examples.set_readings(size)
            points = self.set_points(readings)
            self.sets[size] = self.estimator().fit(points, examples.labels[recording], seed)

    def answer_sets(self, frames: FrameValues) -> np.ndarray:
        """See `Member.answer_sets`."""
        estimator = self.sets[self._fitted_size(frames.readings.shape[1])]
        return probabilities(estimator, self.set_points(frames.readings), self.classes)

    def state_dict(self) -> dict[str, Any]:
        """See `Member.state_dict`."""
        sets = {str(size): estimator.state_dict() for size, estimator in self.sets.items()}
        return {**super().state_dict(), "sets": sets}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """See `Member.load_state_dict`."""
        if "whole" in state:
            super().load_state_dict(state)
        for size, arrays in state["sets"].items():
            self.sets[int(size)] = self.estimator().load_state_dict(arrays)

    def _fitted_size(self, frames: int) -> int:
        """Return the largest fitted size up to this number of frames, or else the smallest one."""
        up_to = [size for size in self.sets if size <= frames]
        return max(up_to, default=min(self.sets))
