"""The pooled map, the maximum of each sensor over a view set, as one more view of the set.

Features of frames are kept and joined in many places, and a pooled map is known only where a set is joined. So the
backbone's features carry the frame along, and the head pools the frames and passes the map through the same backbone.
"""

import math

import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.backbone import Backbone
from tactile_viewgcn.nn.perceptron import Perceptron
from tactile_viewgcn.nn.system import ViewSystem


class WithFrame(nn.Module):
    """A backbone's features (B, C) with the frame's sensors behind them: (B, C + H * W).

    Args:
        shape: (H, W) of a frame.
    """

    def __init__(self, backbone: Backbone | Perceptron, shape: tuple[int, int]):
        super().__init__()
        self.backbone = backbone
        self.features = backbone.features + math.prod(shape)

    def forward(self, frames: Tensor) -> Tensor:
        return torch.cat([self.backbone(frames), frames.flatten(1)], dim=1)


class PooledView(ViewSystem):
    """Views (B, k, C + H * W) to the logits of `head` for k + 1 views (B, k + 1, C).

    The pooled map passes in evaluation mode: by the moments of frames, since it is to be compared with frames, and
    without dropout. Gradients reach the backbone's weights.

    Args:
        head: takes any number of views.
        backbone: not a module of this one: its weights are the classifier's.
        shape: (H, W) of a frame.
    """

    def __init__(self, head: ViewSystem, backbone: Backbone | Perceptron, shape: tuple[int, int]):
        super().__init__()
        self.head, self._backbone, self._shape = head, (backbone,), shape
        self.takes_fewer, self.trainable = head.takes_fewer, head.trainable

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        (backbone,), size = self._backbone, math.prod(self._shape)
        features, frames = views.split([views.shape[2] - size, size], dim=2)
        training = backbone.training
        pooled = backbone.eval()(frames.amax(dim=1).unflatten(1, (1, *self._shape)))
        backbone.train(training)
        return self.head(torch.cat([features, pooled[:, None].to(features.dtype)], dim=1))

    def loss(self, logits: Tensor, aux: list[Tensor], labels: Tensor) -> Tensor:
        return self.head.loss(logits, aux, labels)

    def load_frame_classifier(self, weights: dict[str, Tensor]) -> None:
        self.head.load_frame_classifier(weights)
