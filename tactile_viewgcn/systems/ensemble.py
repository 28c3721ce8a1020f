"""An ensemble of systems that read the sensors, `model.members`."""

import numpy as np
from scipy.special import softmax
from torch import nn

from tactile_viewgcn.sensors.sensor_system import SensorData, SensorSystem
from tactile_viewgcn.systems.kernel import Kernel
from tactile_viewgcn.systems.knn import NearestNeighbours
from tactile_viewgcn.systems.lda import LDA
from tactile_viewgcn.systems.logistic import Logistic
from tactile_viewgcn.systems.max_kernel import MaxKernel
from tactile_viewgcn.systems.max_logistic import MaxLogistic
from tactile_viewgcn.systems.max_network import MaxNetwork
from tactile_viewgcn.systems.trees import Trees

MEMBERS: dict[str, type[SensorSystem]] = {
    "trees": Trees,
    "logistic": Logistic,
    "knn": NearestNeighbours,
    "lda": LDA,
    "kernel": Kernel,
    "max_logistic": MaxLogistic,
    "max_kernel": MaxKernel,
    "max_network": MaxNetwork,
}
FLOOR = 0.01  # added to probabilities, so that no member's zero is a veto


class Ensemble(SensorSystem):
    """The sum of the logarithms of the members' probabilities.

    Attributes:
        fitted: where the values of each member but the first begin.
    """

    def __init__(self, *, classes: int, members: list[str]):
        super().__init__(classes=classes)
        self._systems = [MEMBERS[name](classes=classes) for name in members]
        self.members = nn.ModuleList(self._systems)  # whose states are part of this one's

    def fit(self, data: SensorData) -> None:
        for member in self._systems:
            member.fit(data)
        self.fitted = np.cumsum([member.of_frames(data.frames[:1]).shape[1] for member in self._systems])[:-1]

    def of_frames(self, sensors: np.ndarray) -> np.ndarray:
        return np.concatenate([member.of_frames(sensors) for member in self._systems], axis=1)

    def logits(self, values: np.ndarray) -> np.ndarray:
        parts = np.split(values, self.fitted, axis=-1)
        probabilities = [softmax(of.logits(part), axis=1) for of, part in zip(self._systems, parts, strict=True)]
        return np.log(np.stack(probabilities) + FLOOR).sum(axis=0)
