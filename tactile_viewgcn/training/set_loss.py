"""The loss of a batch of view sets, and the features of frames that view sets share between optimiser steps."""

import torch
import torch.distributed as dist
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.training import distributed
from tactile_viewgcn.training.inputs import Augmentation, FrameInputs
from tactile_viewgcn.training.optim import num_batches


class FeatureBank:
    """The latest features, or maps, of training frames, for views that do not pass through the backbone again.

    Features change slowly in fine-tuning. They come from training mode, with noise and dropout. `feature_shape` of a
    frame is (C,) or (C, H, W).
    """

    def __init__(self, frames: int, feature_shape: tuple[int, ...], compute: Compute):
        self._compute = compute
        dtype = torch.bfloat16 if len(feature_shape) > 1 and compute.precision == "bfloat16" else compute.dtype
        self.values = torch.zeros((frames, *feature_shape), dtype=dtype, device=compute.device)

    @torch.no_grad()
    def fill(self, backbone: nn.Module, frames: FrameInputs, *, batch: int, augment_frames: Augmentation) -> None:
        """Store the features of all frames (n, 1, H, W), in batches in random order, from torch's default generator.

        The backbone is left in training mode, and the running moments of its batch normalisation are updated. Every
        process computes all features, and takes those of the first.
        """
        backbone.train()
        with self._compute.autocast():
            for index in torch.randperm(len(frames)).tensor_split(num_batches(len(frames), batch)):
                self.values[self._compute.to_device(index)] = backbone(augment_frames(frames[index]))
        if dist.is_initialized():
            dist.broadcast(self.values, 0)

    def nodes(self, sets: Tensor, fresh: Tensor, features: Tensor, first: Tensor) -> Tensor:
        """Features (b, k, ...) of this process's view sets: new in the columns `fresh`, from the bank in the others.

        The new features of all processes are stored; of a frame that occurs more than once, those of its first place.

        Args:
            sets: (B, k) indices of frames, of the whole batch.
            fresh: (B, f) columns of the sets.
            features: (b, f, ...) of these columns, of this process's part.
            first: (B * f) the first place of each of these frames among them.
        """
        part = distributed.rows(len(sets))
        rows = torch.arange(len(features), device=sets.device)[:, None].expand(-1, fresh.shape[1])
        nodes = self.values[sets[part]].index_put((rows, fresh[part]), features)
        new = distributed.gather(features, len(sets)).flatten(0, 1)
        self.values[sets.gather(1, fresh).flatten()] = new[first]
        return nodes


class SetLoss(nn.Module):
    """A network's loss of this process's part of a batch of view sets; without a bank all frames pass the backbone."""

    def __init__(self, network: ViewNetwork, bank: FeatureBank | None, augment_frames: Augmentation, compute: Compute):
        super().__init__()
        self.network, self.bank, self.augment_frames, self.compute = network, bank, augment_frames, compute

    def forward(self, frames: Tensor, labels: Tensor, sets: Tensor, fresh: Tensor, first: Tensor) -> Tensor:
        """The loss, a scalar, of the whole batch's arguments.

        Args:
            frames: (B * f, 1, H, W) that pass through the backbone; labels: (B,) of the sets.
            sets, fresh, first: see `FeatureBank.nodes`.
        """
        count, rows, each = len(sets), distributed.rows(len(sets)), fresh.shape[1]
        frames = self.augment_frames(frames)[rows.start * each : rows.stop * each]
        with self.compute.autocast():
            features = self.network.backbone(frames).unflatten(0, (-1, each))
        nodes = features if self.bank is None else self.bank.nodes(sets, fresh, features, first)
        logits, aux = self.network.head(nodes)
        return distributed.weighted(self.network.head.loss(logits, aux, labels[rows]), count)
