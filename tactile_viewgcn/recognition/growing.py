"""A recording that grows frame by frame: each frame is read once, and all are answered together."""

from typing import Any

import numpy as np

from tactile_viewgcn.members.frame_values import FrameValues
from tactile_viewgcn.recognition.calibration import Classifier
from tactile_viewgcn.recognition.model_file import Content
from tactile_viewgcn.recognition.raw_counts import fault_of, is_untouched, is_weak

FIRST_ROOM = 64  # frames
TOO_WEAK = "it reads as little as a hand that touches nothing"
NOT_FINITE = "the model's answer is not finite; expected probabilities: train it again"


class GrowingRecording:
    """Frames in contact, and the answer to those that there are so far.

    The classifier's values of a frame are computed once, before the first answer that needs them.

    Args:
        content: of the model's file.
        classifier: ready for answers.
    """

    def __init__(self, content: Content, classifier: Classifier):
        self._content = content
        self._classifier = classifier
        self._counts = _Frames()
        self._excess = _Frames()
        self._inputs = _Frames()
        self._values: Any = None  # of all inputs
        self._answered = 0  # number of frames of the last answer
        self._probabilities: np.ndarray | None = None  # the last answer
        self._next_check = 1  # number of frames at which the scale is checked again

    def __len__(self) -> int:
        return len(self._counts)

    def add(self, counts: np.ndarray, mean: np.ndarray) -> None:
        """Add a frame in contact.

        Args:
            counts: (H, W).
            mean: (H, W) its baseline.
        """
        excess = counts - mean
        self._counts.add(counts)
        self._excess.add(excess)
        with np.errstate(all="ignore"):  # as of the answer: whether it is finite is checked
            self._inputs.add(self._content.inputs(excess))

    def answer(self, *, is_last: bool) -> tuple[np.ndarray | None, str]:
        """Return the probabilities float32 (classes,); or None, and why, if it is for good.

        Readings that are too weak or too strong have no answer, as in `Recogniser.answer_table`. A
        hand that closes reads little at first: that is a reason only if no frame follows. The scale
        is checked with each answer until there is one, then whenever the frames have doubled, and
        at the end.

        Args:
            is_last: whether no frame follows.
        """
        count = len(self)
        if is_last or count >= self._next_check:
            fault, may_pass = self._fault()
            if may_pass and not is_last:
                return None, ""
            if fault:
                return None, fault
        if count >= self._next_check:
            self._next_check = 2 * count
        if self._answered < count:
            self._probabilities = self._answer_anew()
            self._answered = count
        if self._probabilities is None:
            return None, NOT_FINITE
        return self._probabilities, ""

    def _fault(self) -> tuple[str, bool]:
        """Return what is wrong with the readings, "" if nothing, and if more frames may mend it."""
        plan = self._content.plan
        counts = self._counts.array
        excess = self._excess.array
        in_contact = np.ones(len(counts), dtype=bool)
        may_pass = is_weak(plan, excess)
        if is_untouched(plan, counts, in_contact, excess):
            return TOO_WEAK, may_pass
        return fault_of(plan, counts, in_contact, excess), may_pass

    def _answer_anew(self) -> np.ndarray | None:
        """Return the probabilities by all frames; None if they are not finite."""
        inputs = self._inputs.array
        with np.errstate(all="ignore"):
            new_values = self._classifier.frame_values(inputs[self._answered :])
            self._values = _joined(self._values, new_values)
            logarithms = self._content.answer_values(self._classifier, inputs, self._values)
            probabilities: np.ndarray = np.exp(logarithms, dtype=np.float32)
        if np.isfinite(probabilities).all():
            return probabilities
        return None


class _Frames:
    """Frames (n, H, W) to which more are added, in room that doubles."""

    def __init__(self) -> None:
        self._room = np.zeros(0)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def array(self) -> np.ndarray:
        """Return the frames (n, H, W)."""
        return self._room[: self._count]

    def add(self, frame: np.ndarray) -> None:
        """Add a frame (H, W); the first one gives the type."""
        if not self._count:
            self._room = np.empty((FIRST_ROOM, *frame.shape), frame.dtype)
        if self._count == len(self._room):
            self._room = np.concatenate([self._room, np.empty_like(self._room)])
        self._room[self._count] = frame
        self._count += 1


def _joined(values: Any, more: Any) -> Any:
    """Return a classifier's values of frames, and of more frames after them.

    Args:
        values: see `Classifier`; None of no frames.
        more: of the frames that follow.
    """
    if values is None:
        return more
    if isinstance(values, FrameValues):
        return FrameValues.concatenated([values, more])
    import torch  # here, since a classifier on the sensors needs none

    return torch.cat([values, more])
