"""STAG's network: a 1x1 convolution on the maps of all views, average pooling, a linear layer.

Sundaram et al., "Learning the signatures of the human grasp using a scalable tactile glove", Nature
569, 698-702 (2019). The convolution has no activation, so it commutes with the pooling. Here it is
a linear layer on pooled features, with the same weights and the same result.
"""

from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.params import Model


class STAGNet(ViewSystem):
    """Features (B, V, C) to logits (B, classes); each place in the view set has its own weights."""

    def __init__(self, viewpoints: Tensor, shape: tuple[int, ...], classes: int, model: Model):
        super().__init__()
        self.join = nn.Linear(len(viewpoints) * shape[0], shape[0])
        self.classifier = nn.Linear(shape[0], classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return the logits (B, classes) of features (B, V, C)."""
        return self.classifier(self.join(views.flatten(1))), []
