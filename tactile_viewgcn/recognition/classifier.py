"""The classifier that `model.system` names: a network on the backbone, or a classifier of what the sensors read.

Both kinds have the same attributes and methods:

- `views`: V. `viewpoints`: (V, 3).
- `transform`: of frames to the input that it reads, see `network_input`; None for the table's.
- `prepare(compute)`: puts it on a device, ready for the answers below.
- `frame_values(inputs)`: values (n, ...) of frames (n, H, W), each alone.
- `view_sets(values, sets)`: logits float32 (A, classes) of view sets (A, k) of indices into these values.
- `frames_of(count)`: indices of the frames that it reads of a recording of `count` frames in contact.
- `recording(values)`: logits float32 (classes,) of a recording, by the values of these frames in the order of time.
- `takes_fewer`: whether `view_sets` also answers fewer frames than V.
"""

from typing import TYPE_CHECKING, Union

import numpy as np
from torch import Tensor

from tactile_viewgcn.nn.network import STAG_SHAPE, ViewNetwork
from tactile_viewgcn.params import Model, on_sensors
from tactile_viewgcn.systems import load_system, system_class

if TYPE_CHECKING:
    from tactile_viewgcn.systems.sensors import SensorClassifier

Classifier = Union[ViewNetwork, "SensorClassifier"]


def build_classifier(viewpoints: Tensor, classes: int, model: Model, shape: tuple[int, int] = STAG_SHAPE) -> Classifier:
    """The classifier for viewpoints (V, 3) and frames (H, W); weights come from torch's default generator."""
    if on_sensors(model.system):
        return load_system(model.system).SensorClassifier(model.members, np.asarray(viewpoints), classes)
    return ViewNetwork(system_class(model.system), viewpoints, classes, model, shape)
