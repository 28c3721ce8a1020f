"""Classifiers of what the sensors read, one or more by `model.members`: nothing is pretrained for them."""

from collections.abc import Sequence

from torch import Tensor

from tactile_viewgcn.sensors.classifier import SensorClassifier


def build(viewpoints: Tensor, classes: int, members: Sequence[str]) -> SensorClassifier:
    """The classifier for viewpoints (V, 3), with nothing fitted yet."""
    return SensorClassifier(members, viewpoints, classes)
