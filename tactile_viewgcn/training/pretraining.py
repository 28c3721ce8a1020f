"""Pretraining: train the backbone from scratch to classify single frames."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as functional
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.backbone import INFERENCE_BATCH, Backbone, extract_features
from tactile_viewgcn.params import Params, Pretrain
from tactile_viewgcn.randomness import torch_generator, torch_seed
from tactile_viewgcn.tables.frames import TRAIN, VALIDATION, Frames
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.training.loop import OnEpoch, Progress, error_rate, fit
from tactile_viewgcn.training.optim import build_optimiser, num_batches


class FrameLoss(nn.Module):
    """Cross-entropy of single frames.

    Args:
        backbone: turns frames into features.
        classifier: turns features into logits.
        compute: device and precision of the backbone.
    """

    def __init__(self, backbone: nn.Module, classifier: nn.Linear, compute: Compute):
        super().__init__()
        self.backbone = backbone
        self.classifier = classifier
        self.compute = compute

    def forward(self, frames: Tensor, labels: Tensor) -> Tensor:
        """Return the mean loss, a scalar.

        Args:
            frames: (B, 1, H, W).
            labels: (B,) classes.
        """
        with self.compute.autocast():
            features = self.backbone(frames)
        logits = self.classifier(features.to(self.classifier.weight.dtype))
        return functional.cross_entropy(logits, labels)


class FrameTraining:
    """The training of a backbone and its classifier on single frames.

    Args:
        loss: the loss, on `compute`'s device.
        train: frames of the training set.
        validation: frames of the validation set, possibly none.
        config: the section `pretrain`, for the batch size.
        compute: device and precision.
        order: CPU generator that draws the order of the frames.
        noise: generator of the frames' noise, which a checkpoint keeps too.
    """

    def __init__(
        self,
        loss: FrameLoss,
        *,
        train: FrameInputs,
        validation: FrameInputs,
        config: Pretrain,
        compute: Compute,
        order: torch.Generator,
        noise: torch.Generator,
    ):
        self.loss = loss
        self.steps = num_batches(len(train), config.batch)
        self.generators = (order, noise)
        self._train = train
        self._validation = validation
        self._compute = compute
        self._order = order

    def batches(self, epoch: int) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield noisy frames (B, 1, H, W) and labels (B,), each frame once, in random order."""
        self.loss.backbone.train()
        order = torch.randperm(len(self._train), generator=self._order)
        for index in order.tensor_split(self.steps):
            labels = self._train.labels[self._compute.to_device(index)]
            yield self._train.noisy(index), labels

    def validate(self) -> dict[str, float]:
        """Return the error rate on the validation set, if there is one."""
        if not len(self._validation):
            return {}
        with self._compute.autocast():
            batches = self._validation.split(INFERENCE_BATCH)
            features = extract_features(self.loss.backbone, batches)
        logits = self.loss.classifier(features)
        return {"validation_error": error_rate(logits, self._validation.labels)}


def pretrain_backbone(
    table: Frames,
    params: Params,
    compute: Compute,
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
) -> tuple[Backbone, nn.Linear, Progress]:
    """Return the backbone and its linear classifier, trained on the training set's anchors.

    Args:
        table: the kept frames.
        params: the sections `pretrain` and `model.backbone`, and the seed are used.
        compute: device and precision.
        checkpoint_path: see `fit`.
        on_epoch: see `fit`.

    Returns:
        The backbone, the classifier, and the progress. For each epoch the progress has the loss
        and, if there is a validation set, its error rate.

    Raises:
        UserError: the training run diverges.
    """
    config = params.pretrain
    seed = params.seed
    order = torch_generator(seed, "pretrain.order")
    noise = torch_generator(seed, "pretrain.noise", compute.device)
    train = _anchor_frames(table, TRAIN, config, compute, noise)
    validation = _anchor_frames(table, VALIDATION, config, compute, noise)
    torch.manual_seed(torch_seed(seed, "pretrain.weights"))  # initial weights and dropout
    backbone = Backbone(params.model.backbone)
    # torch's types lack the memory format
    backbone.to(compute.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    classifier = nn.Linear(backbone.features, len(table.classes), device=compute.device)
    loss = FrameLoss(backbone, classifier, compute)
    training = FrameTraining(
        loss,
        train=train,
        validation=validation,
        config=config,
        compute=compute,
        order=order,
        noise=noise,
    )
    progress = fit(
        "pretrain",
        config,
        training=training,
        optimiser=build_optimiser(config, [{"params": loss.parameters()}]),
        checkpoint_path=checkpoint_path,
        on_epoch=on_epoch,
    )
    return backbone, classifier, progress


def _anchor_frames(
    table: Frames, subset: int, config: Pretrain, compute: Compute, noise: torch.Generator
) -> FrameInputs:
    """Return the network input of the anchors of a `subset`, TRAIN or VALIDATION."""
    index = np.flatnonzero(table.anchor & (table.side == subset))
    return FrameInputs(table, index, compute, noise=config.noise, rng=noise)
