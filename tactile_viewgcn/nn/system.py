"""The interface of every system: several views of one object to class logits, and the loss it learns from.

A system is one file in this folder, named as `model.system` names it, with one subclass of `ViewSystem`. Its
constructor asks by name for what it needs and is given only that: `classes`, `features` (C), `maps` (the shape of a
view's feature maps), `views` (V), `viewpoints` (V, 3) where it has a view-graph, and any key of `model` in params.yaml.

`pooled_view.py` is no system, though its class is a `ViewSystem`: it gives a system one view more.
"""

import torch.nn.functional as functional
from torch import Tensor, nn


class ViewSystem(nn.Module):
    """Views (B, k, ...) to logits (B, classes); k is V, or fewer where the system `takes_fewer`.

    Attributes:
        takes: the backbone's `features` (B, k, C), its `maps` (B, k, C, H, W), or what `sensors` read, see
            `sensor_system.py`.
        in_time_order: views are given from the earliest frame to the latest, whatever their viewpoints.
        takes_fewer: a system for V views also takes fewer.
        trainable: it has weights to fine-tune.
        transform: of frames, where the system needs another than `preprocess.transform`.
        packages: that the system needs besides torch and NumPy.
    """

    takes = "features"
    in_time_order = False
    takes_fewer = False
    trainable = True
    transform: str | None = None
    packages: tuple[str, ...] = ()

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Logits (B, classes), and what `loss` needs besides."""
        raise NotImplementedError

    def loss(self, logits: Tensor, aux: list[Tensor], labels: Tensor) -> Tensor:
        """Loss of `forward`'s results for the classes (B,): cross-entropy, unless the system has its own."""
        return functional.cross_entropy(logits, labels)

    def load_frame_classifier(self, weights: dict[str, Tensor]) -> None:
        """Start from the linear classifier of single frames, `weight` (classes, C) and `bias` (classes,)."""


def shape_classifier(inputs: int, features: int, classes: int, dropout: float) -> nn.Sequential:
    """The paper's classifier of a shape descriptor, (B, inputs) -> (B, classes)."""
    return nn.Sequential(
        nn.Linear(inputs, features), nn.Dropout(dropout), nn.LeakyReLU(0.2), nn.Linear(features, classes)
    )
