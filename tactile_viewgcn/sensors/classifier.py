"""The classifier of view sets that one or more systems on the sensors make; it reads counts above baseline."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.backbone import Batched
from tactile_viewgcn.sensors.estimators import TrainingFrames
from tactile_viewgcn.sensors.systems import SensorSystem, added

BATCH = 128  # frames
MAX_SET_VALUES = 1 << 20  # numbers in the values of a batch of view sets


class SensorClassifier:
    """Systems on the sensors as one classifier, with the methods of `ViewNetwork`.

    Args:
        members: systems whose log-probabilities are added.
        viewpoints: (V, 3); only V is used.
        classes: number of classes.

    Attributes:
        live: bool (H, W) sensors that it reads; unit: of a reading, in counts.
    """

    transform = "counts"

    def __init__(self, members: Sequence[SensorSystem], viewpoints: Tensor, classes: int):
        self.members, self.viewpoints, self.classes = members, viewpoints.float(), classes
        self.live, self.unit = np.zeros((0, 0), dtype=bool), 1.0

    @property
    def views(self) -> int:
        """V."""
        return len(self.viewpoints)

    @property
    def takes_fewer(self) -> bool:
        """Whether it also takes fewer views than V."""
        return all(member.takes_fewer for member in self.members)

    def fit(self, data: TrainingFrames, unit: float) -> None:
        """Fit the members to frames in a unit of counts."""
        self.live, self.unit = data.live, unit
        for member in self.members:
            member.fit(data)
        self._measure()

    def _measure(self) -> None:
        """Set the columns of a frame's values at which those of the second and each later member begin."""
        frame = np.zeros((1, int(self.live.sum())), dtype=np.float32)
        self._starts = np.cumsum([member.frame_values(frame).shape[1] for member in self.members])[:-1]

    def prepare(self, compute: Compute) -> None:
        """Do nothing: it computes on the CPU, in single precision."""

    @torch.no_grad()
    def frame_values(self, frames: Batched) -> Tensor:
        """The members' values (n, F) of frames (n, 1, H, W) of counts above baseline."""
        parts = []
        for part in frames.split(BATCH):
            sensors = part[:, 0].float().cpu().numpy()[:, self.live] / np.float32(self.unit)
            parts.append(np.concatenate([member.frame_values(sensors) for member in self.members], axis=1))
        return torch.from_numpy(np.concatenate(parts))

    def logits(self, values: Tensor, sets: Tensor) -> Tensor:
        """Logits (A, classes) of view sets (A, k) of indices into values (n, F), in batches that fit memory."""
        batch, parts = max(1, MAX_SET_VALUES // (sets.shape[1] * values.shape[1])), []
        for part in sets.split(batch):
            of_members = zip(self.members, np.split(values[part].numpy(), self._starts, axis=-1), strict=True)
            parts.append(added([member.logits(each) for member, each in of_members]))
        return torch.from_numpy(np.concatenate(parts))

    def state_dict(self) -> dict[str, Any]:
        """What it has learnt, without `live`: tensors and plain values."""
        return {"unit": self.unit, "members": [member.state_dict() for member in self.members]}

    def load_state_dict(self, state: dict[str, Any], live: np.ndarray) -> None:
        """Take over what `state_dict` gave, for the sensors `live`, bool (H, W).

        Raises:
            ValueError: parts that do not go together.
        """
        self.live, self.unit = live, float(state["unit"])
        if not self.unit > 0:
            raise ValueError(f"unit is {self.unit:g}; expected more than 0")
        for member, of_member in zip(self.members, state["members"], strict=True):
            member.load_state_dict(of_member, live, self.classes)
        self._measure()
