"""The interface of every network on the backbone: views of one object to logits, and a loss.

A system is one file of systems/ with one subclass of `ViewSystem`. The file has the name that
`model.system` uses.
"""

import torch.nn.functional as functional
from torch import Tensor, nn

DROPOUT = 0.5  # of the hidden units of the classifier; our choice


class ViewSystem(nn.Module):
    """Views (B, k, ...) to logits (B, classes); k is V, or another number that the system takes.

    A subclass is built from `viewpoints` (V, 3), a `shape`, the number of `classes`, and the
    section `model` of params.yaml. The shape is (C,) for a view's features, or (C, H, W) for its
    maps.

    Attributes:
        takes: whether the system reads the backbone's `features` (B, k, C) or its `maps` (B, k, C,
            H, W).
        in_time_order: whether views are sorted from the earliest frame to the latest. Viewpoints
            have no effect then.
        takes_fewer: whether a system that is built for V views also answers fewer, k from 1 to
            V - 1.
        takes_more: whether the system also answers more than V views, such as all frames of a
            recording at once.
        trainable: whether the system has weights to fine-tune.
        capturable: whether a GPU can record the loss. It cannot if a part of the loss is computed
            on the CPU.
    """

    takes = "features"
    in_time_order = False
    takes_fewer = False
    takes_more = False
    trainable = True
    capturable = True

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return the logits (B, classes) of views (B, k, ...), and further tensors for `loss`."""
        raise NotImplementedError

    def loss(self, logits: Tensor, aux: list[Tensor], labels: Tensor) -> Tensor:
        """Return the loss of `forward`'s results: cross-entropy, unless a subclass has another.

        Args:
            logits: (B, classes).
            aux: the further tensors that `forward` returned.
            labels: (B,) classes.
        """
        return functional.cross_entropy(logits, labels)

    def load_frame_classifier(self, weights: dict[str, Tensor]) -> None:
        """Start from the linear classifier of single frames, if the system has such a layer.

        Args:
            weights: `weight` (classes, C) and `bias` (classes,).
        """


def shape_classifier(inputs: int, features: int, classes: int) -> nn.Sequential:
    """Return the paper's classifier of a shape descriptor: (B, inputs) -> (B, classes).

    Args:
        inputs: length of the descriptor.
        features: hidden units.
        classes: number of classes.
    """
    return nn.Sequential(
        nn.Linear(inputs, features),
        nn.Dropout(DROPOUT),
        nn.LeakyReLU(0.2),
        nn.Linear(features, classes),
    )
