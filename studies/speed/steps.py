"""A training step of the backbone, by the pipeline and plainly, in turn with the limits of the machine."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import torch
from torch import Tensor

from studies.speed import limits, plain
from studies.speed.sample import Sample, tensors
from studies.speed.turns import clocked, in_turn
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.frames import full_scale
from tactile_viewgcn.nn.backbone import Backbone
from tactile_viewgcn.split import TRAIN
from tactile_viewgcn.training import Disturbance, frame_losses, generator

ROUNDS = 5
BATCHES, FRAMES = (160, 32), 160  # frames in a batch; frames that are passed each time


def steps(one: Sample, params: SimpleNamespace, compute: Compute) -> dict[str, np.ndarray]:
    """Seconds (rounds,) of the limits, and of training on 160 frames in batches of each size, all in turn.

    Keys: `product PRECISION`, `addition`, and of each batch size N `fast N`, `plain N` and `kernels N`.
    """
    frames, labels = tensors(one.table, TRAIN, compute)
    index = torch.arange(FRAMES, device=compute.device) % len(frames)
    frames, labels, device = frames[index], labels[index], compute.device
    works = {f"product {name}": clocked(limits.product(name, device), device) for name in limits.DTYPES}
    works["addition"] = clocked(limits.addition(device), device)
    for batch in BATCHES:
        ways = trainings(one, params, compute, frames, labels, batch)
        works |= {f"{name} {batch}": clocked(work, device) for name, work in ways.items()}
    return in_turn(works, ROUNDS)


def trainings(
    one: Sample, params: SimpleNamespace, compute: Compute, frames: Tensor, labels: Tensor, batch: int
) -> dict[str, Callable[[], None]]:
    """An epoch over the frames (n, 1, H, W) by the pipeline, by the plain loop, and its convolutions alone."""
    backbone = Backbone(params.model.backbone.width)
    backbone.load_state_dict(one.pretrained["backbone"])
    backbone.to(compute.device, memory_format=torch.channels_last)
    slow = plain.PlainBackbone(backbone)
    convolutions = limits.convolutions(slow, frames[:batch], compute.precision)
    noise = params.pretrain.noise * full_scale(one.table.kind, one.table.scale)
    heads = [torch.nn.Linear(backbone.features, len(one.table.classes), device=compute.device) for _ in range(2)]
    options = {name: getattr(params.pretrain, name) for name in ("lr", "momentum", "weight_decay")}
    optimisers = [
        torch.optim.SGD([*body.parameters(), *head.parameters()], **options)
        for body, head in zip((backbone, slow), heads, strict=True)
    ]
    inputs, order = compute.frames(frames.squeeze(1)), generator(0, "speed.order")
    disturb = Disturbance(noise, params.augment, generator(0, "speed.noise", compute.device))

    def fast() -> None:
        backbone.train()
        how = {"batch": batch, "disturb": disturb, "compute": compute, "order": order}
        for loss in frame_losses(backbone, heads[0], inputs, labels, **how):
            optimisers[0].zero_grad(set_to_none=True)
            loss.backward()
            optimisers[0].step()

    def plainly() -> None:
        plain.pretrain_epoch(slow, heads[1], optimisers[1], frames, labels, batch=batch, noise=noise)

    def kernels() -> None:
        for _ in range(len(frames) // batch):
            convolutions()

    return {"fast": fast, "plain": plainly, "kernels": kernels}
