"""An ensemble of systems on the sensors, `model.members`."""

from tactile_viewgcn.params import Model
from tactile_viewgcn.sensors.pipelines import MEMBERS
from tactile_viewgcn.sensors.systems import Ensemble, SensorSystem


def build(model: Model) -> SensorSystem:
    return Ensemble([MEMBERS[name]() for name in model.members])
