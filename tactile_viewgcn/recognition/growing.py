"""A recording that grows frame by frame and is answered from all its frames so far."""

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
    """The frames in contact so far, and the answer to them.

    The classifier's values of each frame are computed once, before the first answer that needs
    them.

    Args:
        content: of the model's file.
        classifier: is ready for answers.
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
            mean: (H, W) the baseline of this frame.
        """
        excess = counts - mean
        self._counts.add(counts)
        self._excess.add(excess)
        with np.errstate(all="ignore"):  # the answer is checked for numbers that are not finite
            self._inputs.add(self._content.inputs(excess))

    def answer(self, *, is_last: bool) -> tuple[np.ndarray | None, str]:
        """Return the probabilities float32 (classes,), or None with the reason.

        As in `Recogniser.answer_table`, readings that are too weak or too strong have no answer. A
        closing hand reads little at first. Such weak readings are given as the reason only if no
        frame follows; until then the reason is empty.

        The scale is checked before each answer until there is an answer. Afterwards it is checked
        whenever the number of frames has doubled, and at the end.

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
        """Return what is wrong with the readings, or "", and whether more frames can help."""
        plan = self._content.plan
        counts = self._counts.array
        excess = self._excess.array
        in_contact = np.ones(len(counts), dtype=bool)
        may_pass = is_weak(plan, excess)
        if is_untouched(plan, counts, in_contact, excess):
            return TOO_WEAK, may_pass
        return fault_of(plan, counts, in_contact, excess), may_pass

    def _answer_anew(self) -> np.ndarray | None:
        """Return the probabilities from all frames; None if they are not finite."""
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
    """An array of frames (n, H, W) that grows; its room doubles when it is full."""

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
        """Add a frame (H, W); the first frame decides the type."""
        if not self._count:
            self._room = np.empty((FIRST_ROOM, *frame.shape), frame.dtype)
        if self._count == len(self._room):
            self._room = np.concatenate([self._room, np.empty_like(self._room)])
        self._room[self._count] = frame
        self._count += 1


def _joined(values: Any, more: Any) -> Any:
    """Return a classifier's values of frames and of the frames that follow them, joined.

    Args:
        values: of the first frames, see `Classifier`; None if there are none.
        more: of the frames that follow.
    """
    if values is None:
        return more
    if isinstance(values, FrameValues):
        return FrameValues.concatenated([values, more])
    import torch  # here, since a classifier on the sensors does without torch

    return torch.cat([values, more])
