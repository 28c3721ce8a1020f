"""The network input of a table's frames, and the noise that trainings add to it."""

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.tables.frames import Frames, network_input


class FrameInputs:
    """Network input (n, 1, H, W) of a table's frames `index` (n,), computed from their counts batch by batch.

    On CUDA all of it is computed once and kept on the device, where it fits.

    Args:
        noise: standard deviation of `noisy` frames, as a share of full scale.
        rng: of the noise, on the device.

    Attributes:
        labels: classes (n,), on the device.
    """

    def __init__(
        self,
        table: Frames,
        index: np.ndarray,
        compute: Compute,
        *,
        noise: float = 0.0,
        rng: torch.Generator | None = None,
    ):
        self._table, self._index, self._compute, self._rng = table, index, compute, rng
        self._noise = noise * float(
            network_input(np.array(table.scale), table.transform, table.scale)
        )
        self.labels = compute.to_device(torch.from_numpy(table.label[index].astype(np.int64)))
        kept = compute.device.type == "cuda" and compute.fits(
            len(index) * table.live.size * torch.float32.itemsize
        )
        self._on_device = self._computed(index) if kept else None

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, at: Tensor) -> Tensor:
        """Network input (k, 1, H, W), channels last, on the device, of the frames at indices (k,) on the processor."""
        if self._on_device is not None:
            return self._on_device[self._compute.to_device(at)]
        return self._computed(self._index[at.numpy()])

    def noisy(self, at: Tensor) -> Tensor:
        """The frames at indices (k,) with white noise."""
        frames = self[at]
        if not self._noise:
            return frames
        return torch.empty_like(frames).normal_(0, self._noise, generator=self._rng).add_(frames)

    def split(self, size: int) -> Iterator[Tensor]:
        """All frames in order, `size` at a time."""
        return map(self.__getitem__, torch.arange(len(self)).split(size))

    def _computed(self, index: np.ndarray) -> Tensor:
        return self._compute.frames(torch.from_numpy(self._table.inputs(index)))
