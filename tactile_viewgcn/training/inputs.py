"""The network input of a table's frames, and the noise that training adds to it."""

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.tables.frames import Frames, network_input


class FrameInputs:
    """Network input (n, 1, H, W) of some frames of a table, computed batch by batch from counts.

    If all of it fits on a GPU, it is computed once and kept there.

    Args:
        table: the kept frames.
        index: (n,) frames of the table.
        compute: the device.
        noise: standard deviation of the noise of `noisy` frames, as a share of full scale.
        rng: generator of the noise, on the device.

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
        self._table = table
        self._index = index
        self._compute = compute
        self._rng = rng
        full_scale = network_input(np.array(table.scale), table.transform, table.scale)
        self._noise = noise * float(full_scale)
        labels = torch.from_numpy(table.label[index].astype(np.int64))
        self.labels = compute.to_device(labels)
        self._on_device: Tensor | None = None
        if compute.device.type == "cuda":
            size = len(index) * table.live.size * torch.float32.itemsize
            if compute.fits(size):
                self._on_device = self._computed(index)

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, index: Tensor) -> Tensor:
        """Return network input (k, 1, H, W), channels last, on the device.

        Args:
            index: (k,) positions among the n frames, on the CPU.
        """
        if self._on_device is not None:
            return self._on_device[self._compute.to_device(index)]
        return self._computed(self._index[index.numpy()])

    def noisy(self, index: Tensor) -> Tensor:
        """Return the frames at positions (k,) with white noise."""
        frames = self[index]
        if not self._noise:
            return frames
        return torch.empty_like(frames).normal_(0, self._noise, generator=self._rng).add_(frames)

    def split(self, size: int) -> Iterator[Tensor]:
        """Yield all frames in order, `size` at a time."""
        for index in torch.split(torch.arange(len(self)), size):
            yield self[index]

    def _computed(self, index: np.ndarray) -> Tensor:
        """Return the network input of frames of the table, on the device."""
        return self._compute.frames(torch.from_numpy(self._table.inputs(index)))
