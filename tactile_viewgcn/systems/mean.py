"""Mean: the mean over the views, as a control for MVCNN's maximum."""

from torch import Tensor

from tactile_viewgcn.nn.system import ViewSystem, shape_classifier
from tactile_viewgcn.params import Model


class MeanViews(ViewSystem):
    """Features (B, k, C) to logits (B, classes), whatever the order of the views."""

    takes_fewer = True
    takes_more = True

    def __init__(self, viewpoints: Tensor, shape: tuple[int, ...], classes: int, model: Model):
        super().__init__()
        self.classifier = shape_classifier(shape[0], shape[0], classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return the logits (B, classes) of features (B, k, C)."""
        return self.classifier(views.mean(dim=1)), []
