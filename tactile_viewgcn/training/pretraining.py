"""The backbone, trained from scratch to tell objects by single frames."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from tactile_viewgcn.checkpoint import Checkpoint, Progress
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.epochs import fit
from tactile_viewgcn.frames import Frames, full_scale
from tactile_viewgcn.nn.backbone import Backbone, build_backbone, features_of
from tactile_viewgcn.nn.perceptron import Perceptron
from tactile_viewgcn.params import Params
from tactile_viewgcn.randomness import torch_seed
from tactile_viewgcn.split import TRAIN, VALIDATION
from tactile_viewgcn.training import (
    Disturbance,
    error_rate,
    factor_of,
    frame_losses,
    generator,
    optimiser_of,
    parts,
)


def pretrain_backbone(
    table: Frames, params: Params, compute: Compute, keep: Path | None = None
) -> tuple[Backbone | Perceptron, torch.nn.Linear, Progress]:
    """The backbone and its linear classifier, trained on the anchor frames of the training side.

    Args:
        params: their `seed`, `model.backbone`, `pretrain` and `augment` are read.
        keep: the file where the training is kept after every epoch, and gone on with if it was.

    Returns:
        backbone, classifier, and how it went: per epoch the loss and, where there is a validation side, its error.

    Raises:
        ValueError: the training diverges in its first epoch.
    """
    how, seed, inputs, labels = params.pretrain, params.seed, {}, {}
    for side in (TRAIN, VALIDATION):
        index = np.flatnonzero(table.anchor & (table.side == side))
        inputs[side] = compute.frames(torch.from_numpy(table.inputs(index)))
        labels[side] = torch.from_numpy(table.label[index].astype(np.int64)).to(compute.device)
    torch.manual_seed(torch_seed(seed, "pretrain.weights"))  # initial weights and dropout
    backbone = build_backbone(table.counts.shape[1:], **asdict(params.model.backbone))
    backbone.to(compute.device, memory_format=torch.channels_last)
    classifier = torch.nn.Linear(backbone.features, len(table.classes), device=compute.device)
    optimiser = optimiser_of(how, [{"params": [*backbone.parameters(), *classifier.parameters()]}])
    order, on_device = generator(seed, "pretrain.order"), generator(seed, "pretrain.noise", compute.device)
    checkpoint = Checkpoint(
        keep,
        {"backbone": backbone, "classifier": classifier, "optimiser": optimiser},
        {"order": order, "noise": on_device},
        {},
        compute.device,
    )
    disturb = Disturbance(how.noise * full_scale(table.kind, table.scale), params.augment, on_device)

    def losses(_: int) -> Iterator[Tensor]:
        backbone.train()
        return frame_losses(
            backbone,
            classifier,
            inputs[TRAIN],
            labels[TRAIN],
            batch=how.batch,
            disturb=disturb,
            compute=compute,
            order=order,
        )

    def validate() -> dict[str, float]:
        if not len(labels[VALIDATION]):
            return {}
        with compute.autocast():
            features = features_of(backbone, inputs[VALIDATION])
        logits = classifier(features)
        return {"validation_error": error_rate(logits, labels[VALIDATION])}

    steps = how.epochs * parts(len(labels[TRAIN]), how.batch)
    with tqdm(total=steps, desc="pretrain", unit="batch", disable=None) as bar:
        progress = fit(how.epochs, optimiser, factor_of(how), losses, validate, bar, checkpoint)
    return backbone, classifier, progress
