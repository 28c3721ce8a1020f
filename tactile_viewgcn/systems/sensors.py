"""Simple classifiers of the sensors themselves, one or more by `model.members`: nothing is pretrained for them."""

from collections.abc import Iterable

from torch import Tensor

from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.sensors.pipelines import MEMBERS


def build(viewpoints: Tensor, classes: int, members: Iterable[str]) -> SensorClassifier:
    """The classifier for viewpoints (V, 3), with nothing fitted yet."""
    return SensorClassifier([MEMBERS[name]() for name in members], viewpoints, classes)
