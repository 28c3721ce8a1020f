"""Multinomial logistic regression on which sensors a view set presses lightly, firmly and hard."""

from tactile_viewgcn.params import Model
from tactile_viewgcn.sensors.pipelines import max_logistic
from tactile_viewgcn.sensors.systems import SensorSystem


def build(model: Model) -> SensorSystem:
    return max_logistic()
