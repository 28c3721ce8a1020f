"""Masked pretraining: the backbone predicts sensors that are hidden from those that are not, without labels.

He et al., "Masked autoencoders are scalable vision learners" (arXiv 2111.06377), for a small residual network: half of
a frame is hidden in square patches, and a small decoder predicts the hidden sensors from the backbone's maps. Hidden
sensors read 0, as unpressed ones do. The decoder is not kept.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import torch
import torch.nn.functional as functional
from torch import Tensor, nn
from tqdm import tqdm

from tactile_viewgcn.device import Compute
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.split import TRAIN
from tactile_viewgcn.frames.transform import full_scale
from tactile_viewgcn.nn.backbone import Backbone
from tactile_viewgcn.params import Params
from tactile_viewgcn.randomness import torch_generator
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.training import distributed
from tactile_viewgcn.training.augmentation import Augmentation
from tactile_viewgcn.training.checkpoint import Checkpoint, Progress
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.training.loop import OnEpoch, fit
from tactile_viewgcn.training.losses import frame_losses
from tactile_viewgcn.training.optim import build_optimiser, lr_lambda, num_batches
from tactile_viewgcn.training.replay import Replay

PATCH = 4  # sensors along a side: a cell of the backbone's maps
HIDDEN = 0.5  # share of the patches
CHANNELS = 64  # of the decoder
TINY = 1e-6  # of a standard deviation: where all readings of a batch are alike, nothing is to be predicted


class Decoder(nn.Sequential):
    """Maps (B, C, H / 4, W / 4), rounded up, to frames (B, 1, H', W') of whole patches."""

    def __init__(self, maps: int):
        super().__init__(
            nn.Conv2d(maps, CHANNELS, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(CHANNELS, PATCH**2, 3, padding=1),
            nn.PixelShuffle(PATCH),
        )


def pretrain_masked(
    backbone: Backbone,
    table: Frames,
    params: Params,
    compute: Compute,
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
) -> Progress:
    """Train the backbone's convolutions on all frames of the training side, those that are no anchors too.

    Args:
        params: `seed`, `pretrain` and `augment` are read; all but the number of epochs is that of the pretraining.
        checkpoint_path: where the training is saved after every epoch; a saved one is continued.
        on_epoch: called after every epoch, see `fit`, with the `masked_loss`.

    Returns:
        the progress: per epoch the loss, see `masked_loss`.

    Raises:
        UserError: the training diverges.
    """
    config, seed = replace(params.pretrain, epochs=params.pretrain.masked_epochs), params.seed
    frames, live = FrameInputs(table, table.on(TRAIN), compute), torch.from_numpy(table.live).to(compute.device)
    decoder = Decoder(backbone.features).to(compute.device)
    trained = nn.ModuleList([backbone, decoder])
    optimiser = build_optimiser(config, [{"params": trained.parameters()}])
    order = torch_generator(seed, "pretrain.masked.order")
    on_device = torch_generator(seed, "pretrain.masked.noise", compute.device)
    checkpoint = Checkpoint(
        checkpoint_path,
        {"trained": trained, "optimiser": optimiser},
        {"order": order, "noise": on_device},
        {},
        compute.device,
    )
    joint_loss = distributed.joint_loss(trained, some_unused=backbone.grid is not None)
    augment_frames = Augmentation(config.noise * full_scale(table.transform, table.scale), params.augment, on_device)
    function = masked_loss(backbone.feature_maps, decoder, live, augment_frames, compute)
    loss_of = Replay(function, trained.parameters(), [on_device])
    no_labels = torch.zeros(len(frames), dtype=torch.int64, device=compute.device)

    def losses(_: int) -> Iterator[Tensor]:
        trained.train()
        return map(
            joint_loss, frame_losses(loss_of, frames, no_labels, batch=config.batch, compute=compute, order=order)
        )

    def report(epoch: int, values: dict[str, float]) -> None:
        if on_epoch is not None:
            on_epoch(epoch, {"masked_loss": values["loss"]})

    steps = config.epochs * num_batches(len(frames), config.batch)
    with tqdm(total=steps, desc="pretrain, masked", unit="batch", disable=None) as bar:
        progress = fit(config.epochs, optimiser, lr_lambda(config), losses, dict, bar, checkpoint, report)
    if progress.diverged:
        raise UserError(f"pretrain.masked_epochs: {progress.diverged}")
    return progress


def masked_loss(
    maps: Callable[[Tensor], Tensor], decoder: nn.Module, live: Tensor, augment_frames: Augmentation, compute: Compute
) -> Callable[[Tensor, Tensor], Tensor]:
    """A function of a batch's frames (B, 1, H, W): the mean squared error at hidden live sensors.

    The decoder predicts standard deviations from the batch's mean reading, so 1 is what the mean has. The loss is of
    this process's part of the batch. Labels are given and not read.

    Args:
        maps: frames to the backbone's maps.
        live: bool (H, W).
        augment_frames: its generator draws the masks too.
    """
    cells = live.flatten().nonzero().squeeze(1)

    def loss(frames: Tensor, _: Tensor) -> Tensor:
        frames, rows = augment_frames(frames), distributed.rows(len(frames))
        hidden = hidden_sensors(frames, augment_frames.rng)
        readings = frames.flatten(1)[:, cells]
        target = (frames - readings.mean()) / readings.std().clamp(min=TINY)
        counted = hidden & live
        each = counted.sum() / len(frames)  # hidden live sensors of a frame, in the whole batch
        with compute.autocast():
            predicted = decoder(maps(frames.masked_fill(hidden, 0)[rows]))
        height, width = live.shape
        error = (predicted[..., :height, :width].to(target.dtype) - target[rows]).square()
        return (error * counted[rows]).sum() / (each * len(error)).clamp(min=1)

    return loss


def hidden_sensors(frames: Tensor, rng: torch.Generator) -> Tensor:
    """bool, as frames (B, 1, H, W): about half are hidden, in squares of 4 x 4; drawn for each frame anew."""
    sides = [-(-side // PATCH) for side in frames.shape[2:]]
    patches = torch.rand((len(frames), 1, *sides), generator=rng, device=frames.device)
    pixels = functional.interpolate(patches, scale_factor=PATCH)[..., : frames.shape[2], : frames.shape[3]]
    return pixels < HIDDEN
