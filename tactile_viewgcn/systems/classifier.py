"""The classifier of view sets: the backbone, and the system that joins the views, its head."""

from dataclasses import asdict
from inspect import signature
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.nn.backbone import build_backbone
from tactile_viewgcn.nn.pooled_view import PooledView, WithFrame
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.params import Model
from tactile_viewgcn.sensors.sensor_system import SensorFeatures, SensorSystem
from tactile_viewgcn.systems import system_class

STAG_SHAPE = (32, 32)
MAX_COORDINATE = 1e9  # of a viewpoint: its square, and what an edge's MLP makes of it, stay inside float32
MAX_NODE_VALUES = 1 << 20  # numbers in the nodes of a batch of view sets; a larger batch gains no speed


class Classifier(nn.Module):
    """The backbone and the head for V views; `backbone` makes features of frames, `head` logits of their view sets.

    Args:
        viewpoints: (V, 3).
        classes: number of classes.
        model: which backbone and which system on it, with their options.
        shape: (H, W) of a frame.

    Raises:
        UserError: the system cannot be built for so many views, or at these viewpoints; viewpoints that are not
            finite, or beyond `MAX_COORDINATE`.
    """

    backbone: Any  # Backbone, Perceptron, WithFrame or SensorFeatures
    viewpoints: Tensor

    def __init__(self, viewpoints: Tensor, classes: int, model: Model, shape: tuple[int, int] = STAG_SHAPE):
        super().__init__()
        outside = viewpoints[~(viewpoints.abs() < MAX_COORDINATE)]
        if len(outside):
            raise UserError(
                f"viewpoints hold {float(outside[0]):g}; expected coordinates between "
                f"-{MAX_COORDINATE:g} and {MAX_COORDINATE:g}"
            )
        system = system_class(model.system)
        maps = system.takes == "maps"
        self.references = np.zeros((len(viewpoints), 0))  # see `assignment.reference_views`
        self.register_buffer("viewpoints", viewpoints.float(), persistent=False)
        arguments = asdict(model) | {"classes": classes, "views": len(viewpoints), "viewpoints": viewpoints}
        if system.takes != "sensors":
            self.backbone = build_backbone(shape, maps=maps, **asdict(model.backbone))
            self.feature_shape = self.backbone.map_shape(shape) if maps else (self.backbone.features,)
            arguments |= {"features": self.feature_shape[0], "maps": self.feature_shape}
        self.head: ViewSystem = system(**{name: arguments[name] for name in signature(system).parameters})
        if isinstance(self.head, SensorSystem):
            self.backbone = SensorFeatures(shape, self.head.of_frames)
        if model.pooled_view:
            self.head = PooledView(self.head, self.backbone, shape)
            self.backbone = WithFrame(self.backbone, shape)
            self.feature_shape = (self.backbone.features,)

    @property
    def views(self) -> int:
        """V."""
        return len(self.viewpoints)


def count_weights(module: nn.Module) -> int:
    """Number of weights that a module learns."""
    return sum(weight.numel() for weight in module.parameters())


def view_set_logits(head: ViewSystem, features: Tensor, sets: Tensor) -> Tensor:
    """Logits (A, classes) of view sets (A, k) of indices into features (n, ...), in batches that fit memory.

    Frames are numbered in the order of time.
    """
    batch = max(1, MAX_NODE_VALUES // (sets.shape[1] * features[0].numel()))
    if head.in_time_order:
        sets = sets.sort(dim=1).values
    return torch.cat([head(features[part])[0] for part in sets.split(batch)])
