"""Extremely randomised trees on single frames."""

from tactile_viewgcn.params import Model
from tactile_viewgcn.sensors.pipelines import trees
from tactile_viewgcn.sensors.systems import SensorSystem


def build(model: Model) -> SensorSystem:
    return trees()
