"""What every system is: several views of one object to class logits, and the loss it learns from.

A system is one file here, named as `model.system` names it, with one class called `System`. Its constructor asks
for what it needs by name and is given only that: `classes`, `features` (C), `maps` (the shape of a view's feature
maps), `views` (V), `viewpoints` (V, 3) where it has a view-graph, and any key of `model` in params.yaml.
"""

import torch.nn.functional as functional
from torch import Tensor, nn


class ViewSystem(nn.Module):
    """Views (B, k, ...) of k = V views, or fewer where it `takes_fewer`, to logits (B, classes).

    Attributes:
        takes: `features`, the backbone's (B, k, C), or `maps` (B, k, C, H, W), which are then not read out.
        in_time_order: views are given from the earliest frame to the latest, whatever their viewpoints.
        takes_fewer: a system for V views takes fewer too.
        learns: there is something to fine-tune.
    """

    takes = "features"
    in_time_order = False
    takes_fewer = False
    learns = True

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Logits (B, classes), and what else the loss needs."""
        raise NotImplementedError

    def loss(self, logits: Tensor, also: list[Tensor], labels: Tensor) -> Tensor:
        """Of what `forward` gave and classes (B,): cross-entropy, unless the system has a loss of its own."""
        return functional.cross_entropy(logits, labels)

    def begin(self, classifier: dict[str, Tensor]) -> None:
        """Take over from the linear classifier of single frames, {"weight": (classes, C), "bias": (classes,)}."""


def shape_classifier(inputs: int, features: int, classes: int, dropout: float) -> nn.Sequential:
    """The paper's classifier of a shape descriptor, (B, inputs) -> (B, classes), the same for all that have one."""
    return nn.Sequential(
        nn.Linear(inputs, features), nn.Dropout(dropout), nn.LeakyReLU(0.2), nn.Linear(features, classes)
    )
