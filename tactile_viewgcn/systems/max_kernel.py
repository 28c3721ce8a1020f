"""Kernel ridge regression on the maximum of each sensor over a view set."""

from tactile_viewgcn.params import Model
from tactile_viewgcn.sensors.pipelines import max_kernel
from tactile_viewgcn.sensors.systems import SensorSystem


def build(model: Model) -> SensorSystem:
    return max_kernel()
