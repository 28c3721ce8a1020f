"""The classifier of view sets that `model.system` names: a network on the backbone, or a system on the sensors.

Both kinds have the same methods. `frame_values` turns frames (n, 1, H, W), each alone, into values (n, ...); `logits`
turns view sets (A, k) of indices into these values into logits (A, classes). `views` is V. `transform` names the input
that frames are given as, None for the table's. `prepare` puts the classifier on a device, ready for answers.
"""

from torch import Tensor

from tactile_viewgcn.nn.network import STAG_SHAPE, ViewNetwork
from tactile_viewgcn.params import Model, on_sensors
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.systems import load_system, system_class

Classifier = ViewNetwork | SensorClassifier


def build_classifier(viewpoints: Tensor, classes: int, model: Model, shape: tuple[int, int] = STAG_SHAPE) -> Classifier:
    """The classifier for viewpoints (V, 3) and frames (H, W); weights come from torch's default generator."""
    if on_sensors(model.system):
        return load_system(model.system).build(viewpoints, classes, model.members)
    return ViewNetwork(system_class(model.system), viewpoints, classes, model, shape)
