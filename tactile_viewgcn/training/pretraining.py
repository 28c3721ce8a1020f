"""Pretraining: the backbone is trained from scratch to classify single frames."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as functional
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.backbone import INFERENCE_BATCH, Backbone, extract_features
from tactile_viewgcn.params import Params
from tactile_viewgcn.randomness import torch_generator, torch_seed
from tactile_viewgcn.tables.frames import TRAIN, VALIDATION, Frames
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.training.loop import OnEpoch, Progress, error_rate, fit
from tactile_viewgcn.training.optim import build_optimiser, num_batches


class FrameLoss(nn.Module):
    """Cross-entropy of single frames."""

    def __init__(self, backbone: nn.Module, classifier: nn.Linear, compute: Compute):
        super().__init__()
        self.backbone, self.classifier, self.compute = backbone, classifier, compute

    def forward(self, frames: Tensor, labels: Tensor) -> Tensor:
        """Frames (B, 1, H, W) and labels (B,) to a scalar."""
        with self.compute.autocast():
            features = self.backbone(frames)
        return functional.cross_entropy(
            self.classifier(features.to(self.classifier.weight.dtype)), labels
        )


def pretrain_backbone(
    table: Frames,
    params: Params,
    compute: Compute,
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
) -> tuple[Backbone, nn.Linear, Progress]:
    """The backbone and its linear classifier, trained on the anchor frames of the training side.

    Args:
        checkpoint_path: see `fit`; on_epoch too.

    Returns:
        backbone, classifier, and the progress: per epoch the loss and, where there is a validation
            side, its error.

    Raises:
        UserError: the training diverges.
    """
    config, seed = params.pretrain, params.seed
    order, on_device = (
        torch_generator(seed, "pretrain.order"),
        torch_generator(seed, "pretrain.noise", compute.device),
    )
    anchors = (np.flatnonzero(table.anchor & (table.side == side)) for side in (TRAIN, VALIDATION))
    train, validation = (
        FrameInputs(table, index, compute, noise=config.noise, rng=on_device) for index in anchors
    )
    torch.manual_seed(torch_seed(seed, "pretrain.weights"))  # initial weights and dropout
    backbone = Backbone(params.model.backbone)
    # type: ignore[call-overload]  # torch's types lack it
    backbone.to(compute.device, memory_format=torch.channels_last)
    classifier = nn.Linear(backbone.features, len(table.classes), device=compute.device)
    loss, steps = FrameLoss(backbone, classifier, compute), num_batches(len(train), config.batch)
    optimiser = build_optimiser(config, [{"params": loss.parameters()}])

    def batches(_: int) -> Iterator[tuple[Tensor, Tensor]]:
        backbone.train()
        for index in torch.randperm(len(train), generator=order).tensor_split(steps):
            yield train.noisy(index), train.labels[compute.to_device(index)]

    def validate() -> dict[str, float]:
        if not len(validation):
            return {}
        with compute.autocast():
            features = extract_features(backbone, validation.split(INFERENCE_BATCH))
        return {"validation_error": error_rate(classifier(features), validation.labels)}

    generators = (order, on_device)
    progress = fit(
        "pretrain",
        config,
        steps,
        loss,
        optimiser,
        batches,
        validate,
        generators,
        checkpoint_path,
        on_epoch,
    )
    return backbone, classifier, progress
