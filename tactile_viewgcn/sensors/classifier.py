"""A system on the sensors as a classifier of view sets: it reads frames of counts above baseline."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.backbone import Batched
from tactile_viewgcn.sensors.systems import SensorSystem, TrainingFrames

BATCH = 128  # frames
MAX_SET_VALUES = 1 << 20  # numbers in the values of a batch of view sets


class SensorClassifier:
    """The classifier; what a frame or a view set is, see `ViewNetwork`, whose counterpart it is.

    Args:
        viewpoints: (V, 3), of which only the number counts.
    """

    transform = "counts"

    def __init__(self, system: SensorSystem, viewpoints: Tensor):
        self.system, self.viewpoints = system, viewpoints.float()
        self.live, self.unit = np.zeros((0, 0), dtype=bool), 1.0

    @property
    def views(self) -> int:
        """V."""
        return len(self.viewpoints)

    @property
    def takes_fewer(self) -> bool:
        """Whether it also answers fewer views than V."""
        return self.system.takes_fewer

    @property
    def packages(self) -> tuple[str, ...]:
        """What it needs besides torch and NumPy."""
        return self.system.packages

    def fit(self, data: TrainingFrames, unit: float) -> None:
        """Fit the system to frames in a unit of counts."""
        self.live, self.unit = data.live, unit
        self.system.fit(data)

    def prepare(self, compute: Compute) -> None:
        """Nothing: it computes on the processor, in single precision."""

    @torch.no_grad()
    def frame_values(self, frames: Batched) -> Tensor:
        """The system's values (n, F) of frames (n, 1, H, W) of counts above baseline."""
        parts = []
        for part in frames.split(BATCH):
            sensors = part[:, 0].float().cpu().numpy()[:, self.live] / np.float32(self.unit)
            parts.append(torch.from_numpy(self.system.frame_values(sensors)))
        return torch.cat(parts)

    def logits(self, values: Tensor, sets: Tensor) -> Tensor:
        """Logits (A, classes) of view sets (A, k) of indices into values (n, F), in batches that fit memory."""
        batch = max(1, MAX_SET_VALUES // (sets.shape[1] * values.shape[1]))
        parts = [self.system.logits(values[part].numpy()) for part in sets.split(batch)]
        return torch.from_numpy(np.concatenate(parts))

    def state_dict(self) -> dict[str, Any]:
        """What it has learnt: plain values, tensors and estimators of scikit-learn."""
        return {"live": torch.from_numpy(self.live), "unit": self.unit, "fitted": self.system.fitted}

    def load_state_dict(self, state: dict[str, Any]) -> int:
        """Take the state over, and answer one frame with it: the number of classes.

        Raises:
            ValueError: the answer is none.
        """
        self.live, self.unit, self.system.fitted = state["live"].numpy(), state["unit"], state["fitted"]
        frame = torch.zeros(1, 1, *self.live.shape)
        logits = self.logits(self.frame_values(frame), torch.zeros(1, 1, dtype=torch.int64))
        if not logits.isfinite().all():
            raise ValueError("its answer to an empty frame is not finite")
        return logits.shape[1]
