"""Augmentation of training frames: shift and noise."""

from dataclasses import dataclass

import torch
import torch.nn.functional as functional
from torch import Tensor

from tactile_viewgcn.params import AugmentParams


@dataclass(frozen=True)
class Augmentation:
    """Random changes of training frames: `augment`'s, and white noise of standard deviation `noise`.

    `noise` is in units of network input; the generator is on the device.
    """

    noise: float
    augment: AugmentParams
    rng: torch.Generator

    def __call__(self, frames: Tensor) -> Tensor:
        """Changed frames (B, 1, H, W), a new tensor unless nothing is to be changed."""
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
