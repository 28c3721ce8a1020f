"""The losses of an epoch's batches: of single frames in pretraining, of view sets in fine-tuning."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import torch
import torch.nn.functional as functional
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.frames.inputs import batches
from tactile_viewgcn.training import distributed
from tactile_viewgcn.training.augmentation import Augmentation
from tactile_viewgcn.training.feature_bank import FeatureBank
from tactile_viewgcn.training.optim import num_batches


def error_rate(logits: Tensor, labels: Tensor) -> float:
    """Share of rows whose largest logit is not the label's."""
    return float((logits.argmax(dim=-1) != labels).float().mean())


def frame_losses(
    backbone: nn.Module,
    classifier: nn.Module,
    frames: Tensor,
    labels: Tensor,
    *,
    batch: int,
    augment_frames: Augmentation,
    compute: Compute,
    order: torch.Generator,
) -> Iterator[Tensor]:
    """Cross-entropy of each batch of single frames (n, 1, H, W) in one epoch, of the part that this process computes.

    Batches differ by one frame at most, and every frame is in one.
    """
    parts = torch.randperm(len(frames), generator=order).tensor_split(num_batches(len(frames), batch))
    for index, inputs in batches(frames, parts, lambda part: part, compute):
        augmented, rows = augment_frames(inputs), distributed.rows(len(index))
        with compute.autocast():
            features = backbone(augmented[rows])
        yield functional.cross_entropy(classifier(features.float()), compute.gather(labels, index[rows]))


def set_losses(
    classifier: Any,
    frames: Tensor,
    labels: Tensor,
    plan: Iterable[tuple[np.ndarray, np.ndarray]],
    *,
    bank: FeatureBank | None,
    augment_frames: Augmentation,
    compute: Compute,
) -> Iterator[Tensor]:
    """The system's loss of each batch of view sets in one epoch, of the part that this process computes.

    Args:
        classifier: a `Classifier`; its `backbone` makes features of frames, its `head` logits of view sets.
        frames: (n, 1, H, W), in the order of time inside a recording; labels: (n,).
        plan: for each batch view sets (B, k) of indices into the frames, each set of one label, and the columns (B, f)
            whose frames pass through the backbone.
        bank: holds the features of the other columns; None where all pass through.
    """
    if classifier.head.in_time_order:
        plan = (in_time_order(*sets_and_fresh) for sets_and_fresh in plan)
    for (sets, fresh), inputs in batches(frames, plan, _fresh_frames, compute):
        batch, rows, each = augment_frames(inputs), distributed.rows(len(sets)), fresh.shape[1]
        with compute.autocast():
            features = classifier.backbone(batch[rows.start * each : rows.stop * each]).unflatten(0, (-1, each))
        nodes = features if bank is None else bank.nodes(sets, fresh, features)
        logits, aux = classifier.head(nodes)
        yield classifier.head.loss(logits, aux, compute.gather(labels, torch.from_numpy(sets[rows, 0])))


def _fresh_frames(batch: tuple[np.ndarray, np.ndarray]) -> Tensor:
    """Indices (B * f,) of the frames in the columns (B, f) of view sets (B, k)."""
    return torch.from_numpy(np.take_along_axis(*batch, axis=1).ravel())


def in_time_order(sets: np.ndarray, fresh: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """View sets (B, k) sorted by index, and where their columns `fresh` (B, f) are then, sorted too."""
    order = np.argsort(sets, axis=1, kind="stable")
    place = np.argsort(order, axis=1)
    return np.take_along_axis(sets, order, axis=1), np.sort(np.take_along_axis(place, fresh, axis=1), axis=1)
