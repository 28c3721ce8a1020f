"""The loss of a batch of view sets, and the features of frames that view sets share between optimiser steps."""

import torch
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.training.inputs import FrameInputs, Noise
from tactile_viewgcn.training.optim import num_batches


class FeatureBank:
    """The latest features, or maps, of training frames, for views that do not pass through the backbone again.

    Features change slowly in fine-tuning. They come from training mode, with noise and dropout.

    Args:
        frames: their number.
        feature_shape: of a frame, (C,) or (C, H, W).
    """

    def __init__(self, frames: int, feature_shape: tuple[int, ...], compute: Compute):
        self._compute = compute
        dtype = torch.bfloat16 if len(feature_shape) > 1 and compute.precision == "bfloat16" else torch.float32
        self.values = torch.zeros((frames, *feature_shape), dtype=dtype, device=compute.device)

    @torch.no_grad()
    def fill(self, backbone: nn.Module, frames: FrameInputs, *, batch: int, noise: Noise) -> None:
        """Store the features of all frames (n, 1, H, W), in batches in random order, from torch's default generator.

        The backbone is left in training mode, and the running moments of its batch normalisation are updated.
        """
        backbone.train()
        with self._compute.autocast():
            for index in torch.randperm(len(frames)).tensor_split(num_batches(len(frames), batch)):
                self.values[self._compute.to_device(index)] = backbone(noise(frames[index]))

    def nodes(self, sets: Tensor, fresh: Tensor, features: Tensor, first: Tensor) -> Tensor:
        """Features (B, k, ...) of view sets: new in the columns `fresh`, from the bank in the others.

        The new features are stored; of a frame that occurs more than once, those of its first place.

        Args:
            sets: (B, k) indices of frames.
            fresh: (B, f) columns of the sets.
            features: (B, f, ...) of these columns.
            first: (B * f) the first place of each of these frames among them.
        """
        rows = torch.arange(len(sets), device=sets.device)[:, None].expand_as(fresh)
        nodes = self.values[sets].index_put((rows, fresh), features)
        self.values[sets.gather(1, fresh).flatten()] = features.detach().flatten(0, 1)[first]
        return nodes


class SetLoss(nn.Module):
    """A network's loss of a batch of view sets; without a bank all their frames pass through the backbone."""

    def __init__(self, network: ViewNetwork, bank: FeatureBank | None, compute: Compute):
        super().__init__()
        self.network, self.bank, self.compute = network, bank, compute

    def forward(self, frames: Tensor, labels: Tensor, sets: Tensor, fresh: Tensor, first: Tensor) -> Tensor:
        """The loss, a scalar.

        Args:
            frames: (B * f, 1, H, W) that pass through the backbone; labels: (B,) of the sets.
            sets, fresh, first: see `FeatureBank.nodes`.
        """
        with self.compute.autocast():
            features = self.network.backbone(frames).unflatten(0, fresh.shape)
        nodes = features if self.bank is None else self.bank.nodes(sets, fresh, features, first)
        logits, aux = self.network.head(nodes)
        return self.network.head.loss(logits, aux, labels)
