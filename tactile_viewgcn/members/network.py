"""The member `network`: the network of the preset `network`, which answers single frames.

The caller passes in how the network is trained, since members know neither tables of frames nor
training runs.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np
from scipy.special import softmax

from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.frame_values import FrameValues
from tactile_viewgcn.members.member import Member
from tactile_viewgcn.members.representation import Representation

if TYPE_CHECKING:
    from tactile_viewgcn.device import Compute
    from tactile_viewgcn.nn.network import ViewNetwork

NETWORK: Final = "network"  # name of the member, and of the preset that it is trained with


class NetworkTraining(Protocol):
    """The interface that trains the network on training recordings."""

    def train(self, recordings: np.ndarray) -> "ViewNetwork":
        """Return the network, trained on some recordings bool (R,) and ready for answers."""

    def answers(self, network: "ViewNetwork", recordings: np.ndarray) -> np.ndarray:
        """Return a network's probabilities float32 (n, classes) for n recordings bool (R,)."""


class NetworkMember(Member):
    """Answers each frame; a recording or a view set gets the mean of the log-probabilities.

    Args:
        representation: see `Member`.
        classes: see `Member`.
        network: the network of the preset, with V views and log(1 + max(x, 0)) as its input. None
            before a fit.
        training: trains the network. None if the member is loaded instead of fitted.
    """

    name = NETWORK
    answers_frames = True
    answers_sets = True

    def __init__(
        self,
        representation: Representation,
        classes: int,
        *,
        network: "ViewNetwork | None" = None,
        training: NetworkTraining | None = None,
    ):
        super().__init__(representation, classes)
        self.network = network
        self.training = training

    def fit(
        self, examples: Examples, recordings: np.ndarray, *, seed: int, quick: bool = False
    ) -> None:
        """Train the network; for the arguments see `Member.fit`.

        Raises:
            UserError: the training run diverges.
        """
        self.network = self._training().train(recordings)

    def answer_examples(self, examples: Examples, recordings: np.ndarray) -> np.ndarray:
        """See `Member.answer_examples`."""
        return self._training().answers(self._network(), recordings)

    def answer_frames(self, counts: np.ndarray, readings: np.ndarray) -> np.ndarray:
        """Return the log-probabilities float32 (n, classes) of single frames; see `Member`."""
        network = self._network()
        features = network.frame_values(np.log1p(np.maximum(counts, 0)))
        single_frames = np.arange(len(counts))[:, None]
        return network.view_sets(features, single_frames)

    def answer_recordings(self, frames: FrameValues) -> np.ndarray:
        """See `Member.answer_recordings`."""
        return self._mean(frames)

    def answer_sets(self, frames: FrameValues) -> np.ndarray:
        """See `Member.answer_sets`."""
        return self._mean(frames)

    def prepare(self, compute: "Compute") -> None:
        """See `Member.prepare`."""
        self._network().prepare(compute)

    def state_dict(self) -> dict[str, Any]:
        """See `Member.state_dict`."""
        weights = self._network().state_dict()
        return {name: weight.cpu().contiguous().numpy() for name, weight in weights.items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """See `Member.load_state_dict`."""
        import torch

        weights = {name: torch.from_numpy(array) for name, array in state.items()}
        self._network().load_state_dict(weights, assign=True)

    def _mean(self, frames: FrameValues) -> np.ndarray:
        """Return the probabilities (B, classes) from the mean of the frames' log-probabilities."""
        answers: np.ndarray = softmax(frames.answers[self.name].mean(axis=1), axis=1)
        return answers

    def _network(self) -> "ViewNetwork":
        if self.network is None:
            raise ValueError("the network is not trained")
        return self.network

    def _training(self) -> NetworkTraining:
        if self.training is None:
            raise ValueError("the network was loaded from a file, so it cannot be trained")
        return self.training
