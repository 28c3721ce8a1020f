"""The interface of a member: a fit, answers to recordings and to view sets, and a state."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.frame_values import FrameValues
from tactile_viewgcn.members.representation import Representation

if TYPE_CHECKING:
    from tactile_viewgcn.device import Compute


class Member(ABC):
    """One way to recognise the object from the readings of the sensors.

    The methods of a member are called in this order: `measure` once, then `fit` and `fit_sets`,
    then the answers. An out-of-fold answer calls `fit` on a copy of the member, then
    `answer_examples`. So `fit` replaces everything that an earlier fit has left. For a member that
    is read from a file, `load_state_dict` takes the place of `measure` and the fits.

    Args:
        representation: scales counts to readings.
        classes: number of classes.

    Attributes:
        name: the member's name in `model.members` of params.yaml.
        answers_frames: whether the member answers each frame on its own. Its answers to several
            frames are then made from the results of `answer_frames`.
        answers_sets: whether the member answers view sets. Their frames have no order, so a member
            that needs the order of time does not.
    """

    name: ClassVar[str]
    answers_frames: ClassVar[bool] = False
    answers_sets: ClassVar[bool] = False

    def __init__(self, representation: Representation, classes: int):
        self.representation = representation
        self.classes = classes

    def measure(self, examples: Examples, *, seed: int) -> None:  # noqa: B027  # most need nothing
        """Measure on all training recordings everything that needs no labels.

        Args:
            examples: the training recordings.
            seed: seed of the member's random choices.
        """

    @abstractmethod
    def fit(
        self, examples: Examples, recordings: np.ndarray, *, seed: int, quick: bool = False
    ) -> None:
        """Fit the answers to whole recordings.

        Args:
            examples: the training recordings and their labels.
            recordings: bool (R,), the recordings to fit to.
            seed: seed of the member's random choices.
            quick: whether fewer trees or frames suffice, as for an out-of-fold answer.
        """

    def fit_sets(self, examples: Examples, *, seed: int) -> None:  # noqa: B027  # few have one
        """Fit the answers to view sets, if they need a separate fit.

        Args:
            examples: the training recordings and their labels.
            seed: seed of the member's random choices.
        """

    @abstractmethod
    def answer_examples(self, examples: Examples, recordings: np.ndarray) -> np.ndarray:
        """Return the probabilities float32 (n, classes) of whole training recordings.

        Args:
            examples: the training recordings.
            recordings: bool (R,), the n recordings to answer, which the fit held out.
        """

    def answer_frames(self, counts: np.ndarray, readings: np.ndarray) -> np.ndarray:
        """Return the answers float32 (n, classes) to single frames, if the member gives such.

        Args:
            counts: (n, H, W) above baseline.
            readings: (n, S) scaled readings of the live sensors.

        Raises:
            NotImplementedError: the member does not answer single frames.
        """
        raise NotImplementedError(f"{self.name} does not answer single frames")

    @abstractmethod
    def answer_recordings(self, frames: FrameValues) -> np.ndarray:
        """Return the probabilities (B, classes) of whole recordings.

        Args:
            frames: values (B, T, ...) of the recordings' frames in the order of time.
        """

    def answer_sets(self, frames: FrameValues) -> np.ndarray:
        """Return the probabilities (B, classes) of view sets, if the member answers them.

        Args:
            frames: values (B, k, ...) of the view sets' frames.

        Raises:
            NotImplementedError: the member does not answer view sets.
        """
        raise NotImplementedError(f"{self.name} does not answer view sets")

    def prepare(self, compute: "Compute") -> None:  # noqa: B027  # only a network needs it
        """Prepare for answers on a device; a member that computes on the CPU does nothing.

        Args:
            compute: the device and its precision.
        """

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Return everything that the member has learnt, as arrays in nested mappings."""

    @abstractmethod
    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore the state that `state_dict` returned.

        Args:
            state: arrays in nested mappings.

        Raises:
            KeyError: a part is missing.
        """
