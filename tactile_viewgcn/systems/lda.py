"""Principal components and linear discriminant analysis of single frames."""

from tactile_viewgcn.params import Model
from tactile_viewgcn.sensors.pipelines import lda
from tactile_viewgcn.sensors.systems import SensorSystem


def build(model: Model) -> SensorSystem:
    return lda()
