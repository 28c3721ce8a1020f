"""The losses of an epoch's batches: of single frames in pretraining, of view sets in fine-tuning."""

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np
import torch
import torch.nn.functional as functional
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.training import distributed
from tactile_viewgcn.training.augmentation import Augmentation
from tactile_viewgcn.training.feature_bank import FeatureBank
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.training.optim import num_batches

if TYPE_CHECKING:  # of fine-tuning alone
    from tactile_viewgcn.nn.network import ViewNetwork


def error_rate(logits: Tensor, labels: Tensor) -> float:
    """Share of rows whose largest logit is not the label's."""
    return float((logits.argmax(dim=-1) != labels).float().mean())


class FrameLoss(nn.Module):
    """Cross-entropy of this process's part of a batch of single frames."""

    def __init__(self, backbone: nn.Module, classifier: nn.Linear, augment_frames: Augmentation, compute: Compute):
        super().__init__()
        self.backbone, self.classifier = backbone, classifier
        self.augment_frames, self.compute = augment_frames, compute

    def forward(self, frames: Tensor, labels: Tensor) -> Tensor:
        """Frames (B, 1, H, W) and labels (B,) of the whole batch to a scalar."""
        count, rows = len(frames), distributed.rows(len(frames))
        frames = self.augment_frames(frames)[rows]
        with self.compute.autocast():
            features = self.backbone(frames)
        logits = self.classifier(features.to(self.classifier.weight.dtype))
        return distributed.weighted(functional.cross_entropy(logits, labels[rows]), count)


class SetLoss(nn.Module):
    """A network's loss of this process's part of a batch of view sets; without a bank all frames pass the backbone."""

    def __init__(
        self, network: "ViewNetwork", bank: FeatureBank | None, augment_frames: Augmentation, compute: Compute
    ):
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


def frame_losses(
    loss_of: Callable[[Tensor, Tensor], Tensor],
    frames: FrameInputs,
    labels: Tensor,
    *,
    batch: int,
    compute: Compute,
    order: torch.Generator,
) -> Iterator[Tensor]:
    """The loss of each batch of single frames (n, 1, H, W) in one epoch, in random order."""
    for index in torch.randperm(len(frames), generator=order).tensor_split(num_batches(len(frames), batch)):
        yield loss_of(frames[index], compute.gather(labels, index))


def set_losses(
    loss_of: Callable[..., Tensor],
    frames: FrameInputs,
    labels: Tensor,
    plan: Iterable[tuple[np.ndarray, np.ndarray]],
    *,
    in_time_order: bool,
    compute: Compute,
) -> Iterator[Tensor]:
    """The loss of each batch of view sets in one epoch.

    Args:
        loss_of: see `SetLoss.forward`.
        frames: (n, 1, H, W), in the order of time inside a recording; labels: (n,).
        plan: `sets` and `fresh` of each batch, see `SideViewSets.batches`.
    """
    for sets, fresh in plan:
        if in_time_order:
            sets, fresh = sort_by_time(sets, fresh)
        index = np.take_along_axis(sets, fresh, axis=1).ravel()
        places = (compute.to_device(torch.from_numpy(each)) for each in (sets, fresh, first_places(index)))
        yield loss_of(frames[torch.from_numpy(index)], compute.gather(labels, torch.from_numpy(sets[:, 0])), *places)


def first_places(index: np.ndarray) -> np.ndarray:
    """For each entry of `index` (n,) the first place with that value."""
    _, first, place = np.unique(index, return_index=True, return_inverse=True)
    return first[place]


def sort_by_time(sets: np.ndarray, fresh: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """View sets (B, k) sorted by index, and where their columns `fresh` (B, f) are then, sorted too."""
    order = np.argsort(sets, axis=1, kind="stable")
    place = np.argsort(order, axis=1)
    return np.take_along_axis(sets, order, axis=1), np.sort(np.take_along_axis(place, fresh, axis=1), axis=1)
