"""The network input of a table's frames, for trainings and trials, and the noise that trainings add."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.tables.frames import Frames


class FrameInputs:
    """Network input (n, 1, H, W) of a table's frames `index` (n,), computed from their counts batch by batch.

    On CUDA all of it is computed once and kept on the device, where it fits.

    Attributes:
        labels: classes (n,), on the device.
    """

    def __init__(self, table: Frames, index: np.ndarray, compute: Compute):
        self._table, self._index, self._compute = table, index, compute
        self.labels = compute.to_device(torch.from_numpy(table.label[index].astype(np.int64)))
        kept = compute.device.type == "cuda" and compute.fits(len(index) * table.live.size * torch.float32.itemsize)
        self._on_device = self._computed(index) if kept else None

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, at: Tensor) -> Tensor:
        """Network input (k, 1, H, W), channels last, on the device, of the frames at indices (k,) on the processor."""
        if self._on_device is not None:
            return self._on_device[self._compute.to_device(at)]
        return self._computed(self._index[at.numpy()])

    def split(self, size: int) -> Iterator[Tensor]:
        """All frames in order, `size` at a time."""
        return map(self.__getitem__, torch.arange(len(self)).split(size))

    def _computed(self, index: np.ndarray) -> Tensor:
        return self._compute.frames(torch.from_numpy(self._table.inputs(index)))


@dataclass(frozen=True)
class Noise:
    """White noise for training frames.

    Attributes:
        std: its standard deviation, in units of network input.
        rng: on the device of the frames.
    """

    std: float
    rng: torch.Generator

    def __call__(self, frames: Tensor) -> Tensor:
        """Noisy frames (B, 1, H, W), a new tensor; the same tensor without noise."""
        if not self.std:
            return frames
        return torch.empty_like(frames).normal_(0, self.std, generator=self.rng).add_(frames)
