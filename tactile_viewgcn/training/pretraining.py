"""Pretraining: the backbone is trained from scratch to classify single frames."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

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
from tactile_viewgcn.training.losses import error_rate, frame_loss, frame_losses
from tactile_viewgcn.training.optim import build_optimiser, lr_lambda, num_batches
from tactile_viewgcn.training.replay import Replay
from tactile_viewgcn.training.whole_batch import share_batches


def pretrain_backbone(
    table: Frames,
    params: Params,
    compute: Compute,
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
) -> tuple[Backbone, torch.nn.Linear, Progress]:
    """The backbone and its linear classifier, trained on the anchor frames of the training side.

    Args:
        params: `seed`, `model.backbone`, `pretrain` and `augment` are read.
        checkpoint_path: where the training is saved after every epoch; a saved one is continued.
        on_epoch: called after every epoch, see `fit`.

    Returns:
        backbone, classifier, and the progress: per epoch the loss and, where there is a validation side, its error.

    Raises:
        UserError: the training diverges in its first epoch.
    """
    config, seed, inputs, labels = params.pretrain, params.seed, {}, {}
    for side in (TRAIN, VALIDATION):
        index = np.flatnonzero(table.anchor & (table.side == side))
        inputs[side] = FrameInputs(table, index, compute)
        labels[side] = torch.from_numpy(table.label[index].astype(np.int64)).to(compute.device)
    torch.manual_seed(torch_seed(seed, "pretrain.weights"))  # initial weights and dropout
    backbone = build_backbone(params.model.backbone)
    backbone.to(compute.device, memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's types lack it
    classifier = torch.nn.Linear(backbone.features, len(table.classes), device=compute.device)
    share_batches(backbone)
    joint_loss = distributed.joint_loss(torch.nn.ModuleList([backbone, classifier]))
    weights = [*backbone.parameters(), *classifier.parameters()]
    optimiser = build_optimiser(config, [{"params": weights}])
    order, on_device = torch_generator(seed, "pretrain.order"), torch_generator(seed, "pretrain.noise", compute.device)
    checkpoint = Checkpoint(
        checkpoint_path,
        {"backbone": backbone, "classifier": classifier, "optimiser": optimiser},
        {"order": order, "noise": on_device},
        {},
        compute.device,
    )
    augment_frames = Augmentation(config.noise * full_scale(table.transform, table.scale), params.augment, on_device)
    loss_of = Replay(frame_loss(backbone, classifier, augment_frames, compute), weights, [on_device])

    def losses(_: int) -> Iterator[Tensor]:
        backbone.train()
        batches = frame_losses(loss_of, inputs[TRAIN], labels[TRAIN], batch=config.batch, compute=compute, order=order)
        return map(joint_loss, batches)

    def validate() -> dict[str, float]:
        if not len(labels[VALIDATION]):
            return {}
        with compute.autocast():
            features = distributed.in_parts(lambda part: extract_features(backbone, part), inputs[VALIDATION])
        logits = classifier(features)
        return {"validation_error": error_rate(logits, labels[VALIDATION])}

    steps = config.epochs * num_batches(len(labels[TRAIN]), config.batch)
    with tqdm(total=steps, desc="pretrain", unit="batch", disable=None) as bar:
        progress = fit(config.epochs, optimiser, lr_lambda(config), losses, validate, bar, checkpoint, on_epoch)
    return backbone, classifier, progress
