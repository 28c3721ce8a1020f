"""The interface of every network on the backbone: views of one object to logits, and a loss.

A system is one file of systems/, named as `model.system` names it, with one subclass of
`ViewSystem`.
"""

import torch.nn.functional as functional
from torch import Tensor, nn

DROPOUT = 0.5  # ours: on the shape descriptor


class ViewSystem(nn.Module):
    """Views (B, k, ...) to logits (B, classes); k is V, or what else the system takes.

    A subclass is built from `viewpoints` (V, 3), a `shape`, the number of `classes`, and the
    section `model` of params.yaml. The shape is (C,) of a view's features, or (C, H, W) of its
    maps.

    Attributes:
        takes: what the system reads: the backbone's `features` (B, k, C), or its `maps` (B, k, C,
            H, W).
        in_time_order: whether views come sorted from the earliest frame to the latest; viewpoints
            then play no part.
        takes_fewer: whether a system built for V views also answers fewer, k from 1 to V - 1.
        takes_more: whether it also answers more than V views, such as all frames of a recording at
            once.
        trainable: whether it has weights to fine-tune.
        capturable: whether a GPU can record its loss; False where a part of the loss is computed on
            the CPU.
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
        """Return the loss of `forward`'s results: the cross-entropy, if a subclass has no other.

        Args:
            logits: (B, classes).
            aux: the further tensors.
            labels: (B,) classes.
        """
        return functional.cross_entropy(logits, labels)

    def load_frame_classifier(self, weights: dict[str, Tensor]) -> None:
        """Start from the linear classifier of single frames, where the system has such a layer.

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
