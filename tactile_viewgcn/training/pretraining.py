"""Pretraining: the backbone is trained from scratch to classify single frames."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.backbone import Backbone, build_backbone, extract_features
from tactile_viewgcn.params import Params
from tactile_viewgcn.randomness import torch_generator, torch_seed
from tactile_viewgcn.tables.frames import TRAIN, VALIDATION, Frames
from tactile_viewgcn.tables.transform import full_scale
from tactile_viewgcn.training import distributed
from tactile_viewgcn.training.augmentation import Augmentation
from tactile_viewgcn.training.checkpoint import Checkpoint, Progress
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.training.loop import OnEpoch, fit
from tactile_viewgcn.training.losses import FrameLoss, error_rate, frame_losses
from tactile_viewgcn.training.optim import build_optimiser, lr_lambda, num_batches
from tactile_viewgcn.training.replay import Replay


def pretrain_backbone(
    table: Frames,
    params: Params,
    compute: Compute,
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
) -> tuple[Backbone, nn.Linear, Progress]:
    """The backbone and its linear classifier, trained on the anchor frames of the training side.

    Args:
        checkpoint_path: where the training is saved after every epoch; a saved one is continued.
        on_epoch: see `fit`.

    Returns:
        backbone, classifier, and the progress: per epoch the loss and, where there is a validation side, its error.

    Raises:
        UserError: the training diverges.
    """
    config, seed = params.pretrain, params.seed
    train, validation = (_Anchors(side, table, compute) for side in (TRAIN, VALIDATION))
    torch.manual_seed(torch_seed(seed, "pretrain.weights"))  # initial weights and dropout
    backbone = build_backbone(params.model.backbone)
    backbone.to(compute.device, memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's types lack it
    classifier = nn.Linear(backbone.features, len(table.classes), device=compute.device)
    order, on_device = torch_generator(seed, "pretrain.order"), torch_generator(seed, "pretrain.noise", compute.device)
    noise = config.noise * full_scale(table.transform, table.scale)
    loss = FrameLoss(backbone, classifier, Augmentation(noise, params.augment, on_device), compute)
    weights = list(loss.parameters())
    loss_of = Replay(distributed.parallel(loss), weights, [on_device])
    optimiser = build_optimiser(config, [{"params": weights}])
    checkpoint = Checkpoint(
        checkpoint_path,
        {"backbone": backbone, "classifier": classifier, "optimiser": optimiser},
        {"order": order, "noise": on_device},
        {},
        compute.device,
    )

    def losses(_: int) -> Iterator[Tensor]:
        backbone.train()
        return frame_losses(loss_of, train.frames, train.labels, batch=config.batch, compute=compute, order=order)

    def validate() -> dict[str, float]:
        if not len(validation.labels):
            return {}
        with compute.autocast():
            features = extract_features(backbone, validation.frames)
        return {"validation_error": error_rate(classifier(features), validation.labels)}

    steps, factor = num_batches(len(train.labels), config.batch), lr_lambda(config)
    progress = fit("pretrain", config.epochs, steps, optimiser, factor, losses, validate, checkpoint, on_epoch)
    return backbone, classifier, progress


class _Anchors:
    """Frames and labels of the anchors of one side."""

    def __init__(self, side: int, table: Frames, compute: Compute):
        index = np.flatnonzero(table.anchor & (table.side == side))
        self.frames = FrameInputs(table, index, compute)
        self.labels = torch.from_numpy(table.label[index].astype(np.int64)).to(compute.device)
