"""MVCNN: the element-wise maximum over the views.

Su et al., "Multi-view convolutional neural networks for 3D shape recognition" (arXiv 1505.00880).
"""

from torch import Tensor

from tactile_viewgcn.nn.system import ViewSystem, shape_classifier
from tactile_viewgcn.params import Model


class MVCNN(ViewSystem):
    """Features (B, k, C) to logits (B, classes), whatever the order of the views."""

    takes_fewer = True
    takes_more = True

    def __init__(self, viewpoints: Tensor, shape: tuple[int, ...], classes: int, model: Model):
        super().__init__()
        self.classifier = shape_classifier(shape[0], shape[0], classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return the logits (B, classes) of features (B, k, C)."""
        return self.classifier(views.amax(dim=1)), []
