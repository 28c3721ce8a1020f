"""The classifier of view sets that `model.system` names: a network on the backbone, or a system on the sensors.

Both kinds have the same face. `frame_values` makes values (n, ...) of frames (n, 1, H, W), each alone; `logits` the
logits (A, classes) of view sets (A, k) of indices into these. `views` is V, `transform` which input the frames are,
None for the table's. `prepare` readies the classifier for answers on a device.
"""

from torch import Tensor

from tactile_viewgcn.nn.network import STAG_SHAPE, ViewNetwork
from tactile_viewgcn.params import Model
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.systems import load_system, on_sensors, system_class

Classifier = ViewNetwork | SensorClassifier


def build_classifier(viewpoints: Tensor, classes: int, model: Model, shape: tuple[int, int] = STAG_SHAPE) -> Classifier:
    """The classifier for viewpoints (V, 3) and frames (H, W); weights come from torch's default generator."""
    if on_sensors(model.system):
        return load_system(model.system).build(viewpoints, classes, model.members)
    return ViewNetwork(system_class(model.system), viewpoints, classes, model, shape)
