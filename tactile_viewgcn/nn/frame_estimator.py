"""Systems without a network: an estimator of scikit-learn classifies each frame, and its probabilities are averaged.

The fitted estimator stands in the backbone's place. It is pickled into the checkpoint as a tensor of bytes, so that the
file loads with `weights_only=True`; the estimator itself is unpickled then, which runs code: load such a file only from
somebody you trust.
"""

import pickle
import warnings
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem


class FrameProbabilities(nn.Module):
    """Frames (B, 1, H, W) of network input to an estimator's class probabilities float32 (B, classes).

    Args:
        shape: (H, W) of a frame.
        classes: number of classes; one that the estimator has not seen has probability 0.

    Attributes:
        features: number of classes, what the system on top takes of a view.
        live: bool (H, W), the sensors that the estimator sees.
    """

    live: Tensor

    def __init__(self, shape: tuple[int, int], classes: int):
        super().__init__()
        self.features = classes
        self.estimator: Any = None
        self.register_buffer("live", torch.ones(shape, dtype=torch.bool))

    def fit(self, estimator: Any, frames: np.ndarray, labels: np.ndarray, live: np.ndarray) -> None:
        """Fit an estimator of scikit-learn to frames (n, H, W) of classes (n,), by their live sensors (H, W)."""
        from sklearn.exceptions import ConvergenceWarning

        self.live.copy_(torch.from_numpy(live))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # a limit of iterations belongs to the estimator
            self.estimator = estimator.fit(frames[:, live], labels)

    def forward(self, frames: Tensor) -> Tensor:
        points = frames[:, 0, self.live].float().cpu().numpy()
        probabilities = np.zeros((len(points), self.features), dtype=np.float32)
        probabilities[:, self.estimator.classes_] = self.estimator.predict_proba(points)
        return torch.from_numpy(probabilities).to(frames.device)

    def get_extra_state(self) -> Tensor:
        return torch.frombuffer(bytearray(pickle.dumps(self.estimator)), dtype=torch.uint8)

    def set_extra_state(self, state: Tensor) -> None:
        self.estimator = pickle.loads(state.numpy().tobytes())


class FrameEstimator(ViewSystem):
    """Class probabilities of views (B, k, classes) to the logarithms of their mean, whatever the order of views."""

    takes = "probabilities"
    takes_fewer = True
    trainable = False
    transform = "log"
    packages = ("scikit-learn",)

    def __init__(self, *, classes: int):
        super().__init__()

    def estimator(self, seed: int, shape: tuple[int, int]) -> Any:
        """The estimator with nothing chosen on the data, for training on `shape` = (frames, sensors)."""
        raise NotImplementedError

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        return views.mean(dim=1).clamp_min(torch.finfo(views.dtype).tiny).log(), []
