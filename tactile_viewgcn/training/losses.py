"""The losses of an epoch's batches: of single frames in pretraining, of view sets in fine-tuning."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

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


def error_rate(logits: Tensor, labels: Tensor) -> float:
    """Share of rows whose largest logit is not the label's."""
    return float((logits.argmax(dim=-1) != labels).float().mean())


def frame_losses(
    loss_of: Callable[[Tensor, Tensor], Tensor],
    frames: FrameInputs,
    labels: Tensor,
    *,
    batch: int,
    compute: Compute,
    order: torch.Generator,
) -> Iterator[Tensor]:
    """The loss of each batch of single frames (n, 1, H, W) in one epoch, of the part that this process computes.

    Batches differ by one frame at most, and every frame is in one.
    """
    parts = torch.randperm(len(frames), generator=order).tensor_split(num_batches(len(frames), batch))
    for index in parts:
        yield loss_of(frames[index], compute.gather(labels, index))


def frame_loss(
    backbone: nn.Module, classifier: nn.Linear, augment_frames: Augmentation, compute: Compute
) -> Callable[[Tensor, Tensor], Tensor]:
    """A function of a batch's frames (B, 1, H, W) and labels (B,): the cross-entropy of this process's part of it."""

    def loss(frames: Tensor, labels: Tensor) -> Tensor:
        inputs, rows = augment_frames(frames), distributed.rows(len(frames))
        with compute.autocast():
            features = backbone(inputs[rows])
        return functional.cross_entropy(classifier(features.to(classifier.weight.dtype)), labels[rows])

    return loss


def set_losses(
    loss_of: Callable[..., Tensor],
    frames: FrameInputs,
    labels: Tensor,
    plan: Iterable[tuple[np.ndarray, np.ndarray]],
    *,
    in_time_order: bool,
    compute: Compute,
) -> Iterator[Tensor]:
    """The system's loss of each batch of view sets in one epoch, of the part that this process computes.

    Args:
        loss_of: see `set_loss`.
        frames: (n, 1, H, W), in the order of time inside a recording; labels: (n,).
        plan: for each batch view sets (B, k) of indices into the frames, each set of one label, and the columns (B, f)
            whose frames pass through the backbone.
    """
    if in_time_order:
        plan = (sort_by_time(*sets_and_fresh) for sets_and_fresh in plan)
    for sets, fresh in plan:
        index = np.take_along_axis(sets, fresh, axis=1).ravel()
        places = (compute.to_device(torch.from_numpy(each)) for each in (sets, fresh, first_places(index)))
        yield loss_of(frames[torch.from_numpy(index)], compute.gather(labels, torch.from_numpy(sets[:, 0])), *places)


def set_loss(
    classifier: Any, bank: FeatureBank | None, augment_frames: Augmentation, compute: Compute
) -> Callable[..., Tensor]:
    """A function of a batch of view sets: the system's loss of this process's part of it.

    Its arguments are the frames (B * f, 1, H, W) that pass through the backbone, the labels (B,) of the sets, the sets
    (B, k) of indices, the columns (B, f) of these frames, and `first_places` of their indices.

    Args:
        classifier: a `Classifier`; its `backbone` makes features of frames, its `head` logits of view sets.
        bank: holds the features of the other columns; None where all pass through.
    """

    def loss(frames: Tensor, labels: Tensor, sets: Tensor, fresh: Tensor, first: Tensor) -> Tensor:
        batch, rows, each = augment_frames(frames), distributed.rows(len(sets)), fresh.shape[1]
        with compute.autocast():
            features = classifier.backbone(batch[rows.start * each : rows.stop * each]).unflatten(0, (-1, each))
        nodes = features if bank is None else bank.nodes(sets, fresh, features, first)
        logits, aux = classifier.head(nodes)
        return classifier.head.loss(logits, aux, labels[rows])

    return loss


def first_places(index: np.ndarray) -> np.ndarray:
    """For each entry of `index` (n,) the first place with that value."""
    _, first, place = np.unique(index, return_index=True, return_inverse=True)
    return first[place]


def sort_by_time(sets: np.ndarray, fresh: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """View sets (B, k) sorted by index, and where their columns `fresh` (B, f) are then, sorted too."""
    order = np.argsort(sets, axis=1, kind="stable")
    place = np.argsort(order, axis=1)
    return np.take_along_axis(sets, order, axis=1), np.sort(np.take_along_axis(place, fresh, axis=1), axis=1)
