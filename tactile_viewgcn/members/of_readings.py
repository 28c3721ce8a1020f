"""What the members share that turn the readings of several frames into a point, and answer it."""

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
    """Base of the members with an estimator of points: one point for a recording or a view set.

    View sets have estimators of their own, one for each fitted number of frames. A set of k frames
    has the estimator of the largest fitted number up to k.

    Attributes:
        whole: the estimator of whole recordings; None of a member that answers view sets only.
        sets: the estimators of view sets, by number of frames.
    """

    def __init__(self, representation: Representation, classes: int):
        super().__init__(representation, classes)
        self.whole: Estimator | None = None
        self.sets: dict[int, Estimator] = {}

    @abstractmethod
    def estimator(self, *, quick: bool = False) -> Estimator:
        """Return the member's estimator, not fitted yet.

        Args:
            quick: whether fewer trees suffice.
        """

    @abstractmethod
    def recording_points(self, readings: np.ndarray) -> np.ndarray:
        """Return points (B, F) of whole recordings' readings (B, T, S) in the order of time."""

    def set_points(self, readings: np.ndarray) -> np.ndarray:
        """Return points (B, F) of view sets' readings (B, k, S), which no order of frames changes.

        Raises:
            NotImplementedError: the member does not answer view sets.
        """
        raise NotImplementedError(f"{self.name} does not answer view sets")

    def fit(
        self, examples: Examples, recordings: np.ndarray, *, seed: int, quick: bool = False
    ) -> None:
        """See `Member.fit`."""
        points = examples.recording_points(self.name, self.recording_points)
        labels = examples.labels[recordings]
        self.whole = self.estimator(quick=quick).fit(points[recordings], labels, seed)

    def fit_sets(self, examples: Examples, *, seed: int) -> None:
        """See `Member.fit_sets`."""
        if not self.answers_sets:
            return
        for size in steps(examples.sets, f"{self.name}, fits of view sets", "sizes"):
            readings, recording = examples.set_readings(size)
            points = self.set_points(readings)
            self.sets[size] = self.estimator().fit(points, examples.labels[recording], seed)

    def answer_examples(self, examples: Examples, recordings: np.ndarray) -> np.ndarray:
        """See `Member.answer_examples`."""
        points = examples.recording_points(self.name, self.recording_points)
        return self._probabilities(self.whole, points[recordings])

    def answer_recordings(self, frames: FrameValues) -> np.ndarray:
        """See `Member.answer_recordings`."""
        return self._probabilities(self.whole, self.recording_points(frames.readings))

    def answer_sets(self, frames: FrameValues) -> np.ndarray:
        """See `Member.answer_sets`."""
        estimator = self.sets[self._fitted_size(frames.readings.shape[1])]
        return self._probabilities(estimator, self.set_points(frames.readings))

    def state_dict(self) -> dict[str, Any]:
        """See `Member.state_dict`."""
        state: dict[str, Any] = {}
        if self.whole is not None:
            state["whole"] = self.whole.state_dict()
        state["sets"] = {str(size): fitted.state_dict() for size, fitted in self.sets.items()}
        return state

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """See `Member.load_state_dict`."""
        if "whole" in state:
            self.whole = self.estimator().load_state_dict(state["whole"])
        self.sets = {}
        for size, arrays in state["sets"].items():
            self.sets[int(size)] = self.estimator().load_state_dict(arrays)

    def _fitted_size(self, frames: int) -> int:
        """The largest fitted number of frames up to that many; the smallest one if there is none."""
        up_to = [size for size in self.sets if size <= frames]
        return max(up_to, default=min(self.sets))

    def _probabilities(self, estimator: Estimator | None, points: np.ndarray) -> np.ndarray:
        if estimator is None:
            raise ValueError(f"{self.name} is not fitted to whole recordings")
        return probabilities(estimator, points, self.classes)
