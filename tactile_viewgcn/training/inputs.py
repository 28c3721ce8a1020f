"""The network input of a table's frames, for trainings and trials, and its random changes in training."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as functional
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.params import AugmentParams
from tactile_viewgcn.tables.frames import Frames


class FrameInputs:
    """Network input (n, 1, H, W) of frames, computed from their counts batch by batch.

    On CUDA all of it is computed once and kept on the device, where it fits.

    Args:
        index: (n,) of the frames in the table.
        transform: in place of the table's.

    Attributes:
        labels: classes (n,), on the device.
    """

    def __init__(self, table: Frames, index: np.ndarray, compute: Compute, transform: str | None = None):
        self._table, self._index, self._compute, self._transform = table, index, compute, transform
        self.labels = compute.to_device(torch.from_numpy(table.label[index].astype(np.int64)))
        self._on_device: Tensor | None = None
        size = len(index) * table.live.size * compute.dtype.itemsize
        if compute.device.type == "cuda" and compute.fits(size):
            self._on_device = compute.to_device(self._computed(index))

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, at: Tensor) -> Tensor:
        """Network input (k, 1, H, W), channels last, on the device, of the frames at indices (k,) on the processor."""
        if self._on_device is not None:
            return self._on_device[self._compute.to_device(at)]
        return self._compute.to_device(self._computed(self._index[at.numpy()]))

    def split(self, size: int) -> Iterator[Tensor]:
        """All frames in order, `size` at a time."""
        return map(self.__getitem__, torch.arange(len(self)).split(size))

    def _computed(self, index: np.ndarray) -> Tensor:
        return self._compute.layout(torch.from_numpy(self._table.inputs(index, self._transform)))


@dataclass(frozen=True)
class Augmentation:
    """Random changes of training frames: `augment`'s, and white noise of standard deviation `noise`.

    `noise` is in units of network input; the generator is on the device.
    """

    noise: float
    augment: AugmentParams
    rng: torch.Generator

    def __call__(self, frames: Tensor) -> Tensor:
        """Changed frames (B, 1, H, W); a new tensor, unless there is nothing to change."""
        if self.augment.shift:
            frames = random_shift(frames, self.augment.shift, self.rng)
        if self.noise:
            frames = torch.empty_like(frames).normal_(0, self.noise, generator=self.rng).add_(frames)
        return frames


def random_shift(frames: Tensor, max_shift: int, rng: torch.Generator) -> Tensor:
    """Frames (B, 1, H, W), each moved at random by up to `max_shift` rows and columns; zeros move in."""
    batch, _, height, width = frames.shape
    padded = functional.pad(frames, (max_shift,) * 4)
    offset = torch.randint(2 * max_shift + 1, (2, batch, 1), generator=rng, device=frames.device)
    rows = offset[0] + torch.arange(height, device=frames.device)  # (B, H)
    columns = offset[1] + torch.arange(width, device=frames.device)
    number = torch.arange(batch, device=frames.device)[:, None, None]
    return padded[number, 0, rows[:, :, None], columns[:, None, :]].unsqueeze(1)
