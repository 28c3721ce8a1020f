"""An ensemble of systems on the sensors."""

from tactile_viewgcn.sensors.pipelines import MEMBERS
from tactile_viewgcn.sensors.systems import Ensemble


def build(members: list[str]) -> Ensemble:
    return Ensemble([MEMBERS[name]() for name in members])
