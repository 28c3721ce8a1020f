"""Simple classifiers of the sensors themselves, one or more by `model.members`: nothing is pretrained for them."""

from collections.abc import Iterable

from torch import Tensor

from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.sensors.pipelines import MEMBERS
from tactile_viewgcn.sensors.systems import Ensemble


def build(viewpoints: Tensor, members: Iterable[str]) -> SensorClassifier:
    """The classifier for viewpoints (V, 3), with nothing fitted yet."""
    return SensorClassifier(Ensemble([MEMBERS[name]() for name in members]), viewpoints)
