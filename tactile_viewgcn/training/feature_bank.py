"""Features of frames that view sets share between optimiser steps."""

import math
from tempfile import NamedTemporaryFile

import torch
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.files import root
from tactile_viewgcn.frame_inputs import FrameInputs
from tactile_viewgcn.memory import fits_memory
from tactile_viewgcn.training import distributed
from tactile_viewgcn.training.augmentation import Augmentation
from tactile_viewgcn.training.checkpoint import FOLDER
from tactile_viewgcn.training.inputs import batches
from tactile_viewgcn.training.optim import num_batches


class FeatureBank(nn.Module):
    """The latest features, or maps, of n training frames, for views that do not pass through the backbone again.

    Features change slowly in fine-tuning. They come from training mode, with noise and dropout.

    Args:
        frames: n.
        feature_shape: of one frame, (C,) or (C, H, W).
    """

    values: Tensor

    def __init__(self, frames: int, feature_shape: tuple[int, ...], compute: Compute):
        super().__init__()
        self._compute = compute
        dtype = torch.bfloat16 if len(feature_shape) > 1 and compute.precision == "bfloat16" else compute.dtype
        self.register_buffer("values", _zeros((frames, *feature_shape), dtype, compute.device))

    @torch.no_grad()
    def fill(self, backbone: nn.Module, frames: FrameInputs, *, batch: int, augment_frames: Augmentation) -> None:
        """Store the features of all frames (n, 1, H, W), in batches in random order, from torch's default generator.

        The backbone is left in training mode, and the running moments of its batch normalisation are updated.
        """
        backbone.train()
        parts = torch.randperm(len(frames)).tensor_split(num_batches(len(frames), batch))
        with self._compute.autocast():
            for index, inputs in batches(frames, parts, lambda part: part, self._compute):
                features = backbone(augment_frames(inputs)[distributed.rows(len(index))])
                self.values[self._compute.to_device(index)] = distributed.gather(features)

    def nodes(self, sets: Tensor, fresh: Tensor, features: Tensor, first: Tensor) -> Tensor:
        """Features (b, k, ...) of view sets (B, k): those given for the columns `fresh`, from the bank for the others.

        b of the view sets are this process's part, all B where it trains alone. The given features are stored, those of
        every process; of a frame that occurs more than once, those of its first place.

        Args:
            sets: (B, k) indices of frames.
            fresh: (B, f) columns of the sets.
            features: (b, f, ...) of these columns.
            first: (B * f) the first place of each of these frames among them.
        """
        part = distributed.rows(len(sets))
        rows = torch.arange(len(features), device=sets.device)[:, None].expand(-1, fresh.shape[1])
        nodes = self.values[sets[part]].index_put((rows, fresh[part]), features)
        self.values[sets.gather(1, fresh).flatten()] = distributed.gather(features).flatten(0, 1)[first]
        return nodes


def _zeros(shape: tuple[int, ...], dtype: torch.dtype, device: torch.device) -> Tensor:
    """Zeros on the device; where they take too much of the processor's free memory, in a file that has no name."""
    if device.type != "cpu" or fits_memory(math.prod(shape) * dtype.itemsize):
        return torch.zeros(shape, dtype=dtype, device=device)
    folder = root() / FOLDER
    folder.mkdir(exist_ok=True)
    with NamedTemporaryFile(dir=folder) as file:  # a mapping outlives its file's name
        return torch.from_file(file.name, shared=True, size=math.prod(shape), dtype=dtype).view(shape)
