"""The classifier of view sets that `model.system` names: a network on the backbone, or a system on the sensors."""

from torch import Tensor, nn

from tactile_viewgcn.nn.network import STAG_SHAPE, ViewNetwork
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.params import Model
from tactile_viewgcn.sensors.sensor_system import SensorFeatures, SensorSystem
from tactile_viewgcn.systems import system_class


class SensorClassifier(nn.Module):
    """A system on the sensors in the form of a network: `backbone` and `head`."""

    viewpoints: Tensor

    def __init__(self, system: type[SensorSystem], viewpoints: Tensor, classes: int, model: Model, shape: tuple):
        super().__init__()
        options = {"members": model.members} if model.system == "ensemble" else {}
        self.head: ViewSystem = system(classes=classes, **options)
        self.backbone = SensorFeatures(shape, self.head.of_frames)
        self.register_buffer("viewpoints", viewpoints.float(), persistent=False)

    @property
    def views(self) -> int:
        """V."""
        return len(self.viewpoints)


Classifier = ViewNetwork | SensorClassifier


def build_classifier(
    viewpoints: Tensor, classes: int, model: Model, shape: tuple[int, int] = STAG_SHAPE
) -> ViewNetwork | SensorClassifier:
    """The classifier for viewpoints (V, 3) and frames (H, W); weights come from torch's default generator."""
    system = system_class(model.system)
    kind = ViewNetwork if system.takes != "sensors" else SensorClassifier
    return kind(system, viewpoints, classes, model, shape)
