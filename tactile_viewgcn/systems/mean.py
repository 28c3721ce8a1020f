"""Mean: the mean over the views, the control of MVCNN's maximum."""

from torch import Tensor

from tactile_viewgcn.nn.system import ViewSystem, shape_classifier


class MeanViews(ViewSystem):
    """Features (B, k, C) to logits (B, classes), whatever the order of the views."""

    takes_fewer = True

    def __init__(self, *, features: int, classes: int, dropout: float):
        super().__init__()
        self.classifier = shape_classifier(features, features, classes, dropout)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        return self.classifier(views.mean(dim=1)), []
