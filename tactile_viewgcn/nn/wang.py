"""Wang et al.'s network: STAG's, narrowed, for a tactile glove with an inertial sensor.

The narrow backbone, of 16 and 32 channels with dropout 0.4, is the preset `wang`. The branch for the inertial
sensor is left out: no source that is read here has one.
"""

from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem


class System(ViewSystem):
    """Features (B, V, C) to logits; see `stag` for why a linear layer is the 1x1 convolution of all maps."""

    def __init__(self, *, views: int, features: int, classes: int):
        super().__init__()
        self.join = nn.Linear(views * features, features)
        self.classifier = nn.Linear(features, classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        return self.classifier(self.join(views.flatten(1))), []
