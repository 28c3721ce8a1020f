"""The member `kernel`: kernel ridge regression on single frames, averaged over the frames."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tactile_viewgcn.members import features
from tactile_viewgcn.members.estimators import probabilities
from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.frame_values import FrameValues
from tactile_viewgcn.members.kernels import KernelRidge
from tactile_viewgcn.members.member import Member

FITTED_FRAMES = 2000
QUICKLY_FITTED_FRAMES = 1000


class KernelMember(Member):
    """Answers each frame; a recording or a view set gets the mean of its frames' probabilities.

    Attributes:
        of_frames: the estimator of single frames.
    """

    name = "kernel"
    answers_frames = True
    answers_sets = True
    of_frames: KernelRidge

    def fit(
        self, examples: Examples, recordings: np.ndarray, *, seed: int, quick: bool = False
    ) -> None:
        """See `Member.fit`."""
        most = FITTED_FRAMES
        if quick:
            most = QUICKLY_FITTED_FRAMES
        fitted = recordings[examples.frame_recording]
        points = examples.frame_points(self.name, self._points)[fitted]
        labels = examples.labels[examples.frame_recording][fitted]
        self.of_frames = KernelRidge(most).fit(points, labels, seed)

    def answer_examples(self, examples: Examples, recordings: np.ndarray) -> np.ndarray:
        """See `Member.answer_examples`."""
        answered = recordings[examples.frame_recording]
        points = examples.frame_points(self.name, self._points)[answered]
        of_frames = probabilities(self.of_frames, points, self.classes)
        recording_of_frame = examples.frame_recording[answered]
        means = []
        for recording in np.flatnonzero(recordings):
            means.append(of_frames[recording_of_frame == recording].mean(axis=0))
        return np.stack(means)

    def answer_frames(self, counts: np.ndarray, readings: np.ndarray) -> np.ndarray:
        """Return the probabilities float32 (n, classes) of single frames; see `Member`."""
        return probabilities(self.of_frames, self._points(readings), self.classes)

    def answer_recordings(self, frames: FrameValues) -> np.ndarray:
        """See `Member.answer_recordings`."""
        return self._mean(frames)

    def answer_sets(self, frames: FrameValues) -> np.ndarray:
        """See `Member.answer_sets`."""
        return self._mean(frames)

    def state_dict(self) -> dict[str, Any]:
        """See `Member.state_dict`."""
        return {"of_frames": self.of_frames.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """See `Member.load_state_dict`."""
        self.of_frames = KernelRidge().load_state_dict(state["of_frames"])

    def _points(self, readings: np.ndarray) -> np.ndarray:
        """Return the points (n, F) of single frames' readings (n, S)."""
        if self.representation.blocks is None:
            return readings
        return features.with_blocks(features.pressed(readings), self.representation.blocks)

    def _mean(self, frames: FrameValues) -> np.ndarray:
        """Return the mean (B, classes) of the frames' probabilities."""
        mean: np.ndarray = frames.answers[self.name].mean(axis=1)
        return mean
