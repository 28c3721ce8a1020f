"""The two trainings: the backbone on single frames, then the whole network on view sets.

Both are stochastic gradient descent with momentum; what differs is what a batch holds, what its loss is and how
the learning rate moves. Nothing in an epoch waits for the device.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np
import torch
import torch.nn.functional as functional
from torch import Tensor, nn
from tqdm import tqdm

from tactile_viewgcn.compute import Compute
from tactile_viewgcn.randomness import torch_seed


def batches(count: int, size: int, generator: torch.Generator) -> Iterator[Tensor]:
    """Indices 0 to count - 1 in random order, in batches of at most `size` that differ by one at most.

    So no batch is a lone leftover that batch normalisation could not use, and no frame is left out.
    """
    order = torch.randperm(count, generator=generator)
    yield from order.tensor_split(math.ceil(count / size))


def halving(epoch: int, *, every: int, early: int = 0) -> float:
    """Factor on the learning rate that halves every `every` epochs, each halving `early` epochs sooner."""
    return 0.5 ** ((epoch + early) // every)


def compounding_cosine(epoch: int, *, epochs: int) -> float:
    """The released code's fine-tuning schedule: from epoch 2 on, (1 + cos(pi e / epochs)) / 2, multiplied up."""
    return math.prod((1 + math.cos(math.pi * e / epochs)) / 2 for e in range(2, epoch + 1))


def fit(
    epochs: int,
    optimiser: torch.optim.Optimizer,
    factor: Callable[[int], float],
    losses: Callable[[int], Iterator[Tensor]],
    validate: Callable[[], dict[str, float]],
    bar: tqdm,
) -> dict[str, list[float]]:
    """Run the epochs: a step down each loss, with the learning rates times `factor(epoch)`.

    Args:
        losses: epoch -> its batches' losses, one by one.
        validate: what to note after an epoch besides the mean loss.

    Returns:
        The mean loss and what `validate` gave, a value per epoch each.

    Raises:
        ValueError: the loss is no longer finite.
    """
    schedule = torch.optim.lr_scheduler.LambdaLR(optimiser, factor)
    curves: dict[str, list[float]] = {}
    for epoch in range(epochs):
        total, count = 0.0, 0
        for loss in losses(epoch):
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
            total, count = total + loss.detach(), count + 1
            bar.update()
        mean = float(total) / count
        if not math.isfinite(mean):
            rates = ", ".join(f"{group['lr']:g}" for group in optimiser.param_groups)
            raise ValueError(
                f"training diverged in epoch {epoch + 1} at a learning rate of {rates}: the loss is "
                f"{mean}; lower lr in params.yaml"
            )
        schedule.step()
        for name, value in ({"loss": mean} | validate()).items():
            curves.setdefault(name, []).append(value)
        bar.set_postfix({name: f"{line[-1]:.3f}" for name, line in curves.items()})
    return curves


def error_rate(logits: Tensor, labels: Tensor) -> float:
    """Share of rows whose largest logit is not the label's."""
    return float((logits.argmax(dim=-1) != labels).float().mean())


def noisy(frames: Tensor, noise: float, generator: torch.Generator) -> Tensor:
    """Frames with white noise of that standard deviation added."""
    if noise == 0:
        return frames
    drawn = torch.empty_like(frames).normal_(0, noise, generator=generator)
    return drawn.add_(frames)


def frame_losses(
    backbone: nn.Module,
    classifier: nn.Module,
    frames: Tensor,
    labels: Tensor,
    *,
    batch: int,
    noise: float,
    compute: Compute,
    order: torch.Generator,
    on_device: torch.Generator,
) -> Iterator[Tensor]:
    """Cross-entropy of batches of single frames (n, 1, H, W), for one epoch."""
    for index in batches(len(frames), batch, order):
        index = index.to(compute.device)
        with compute.autocast():
            features = backbone(noisy(frames[index], noise, on_device))
        yield functional.cross_entropy(classifier(features.float()), labels[index])


def set_losses(
    model: nn.Module,
    frames: Tensor,
    labels: Tensor,
    sets: np.ndarray,
    *,
    batch: int,
    noise: float,
    loss: Callable[..., Tensor],
    compute: Compute,
    order: torch.Generator,
    on_device: torch.Generator,
) -> Iterator[Tensor]:
    """Equation 6's loss of batches of view sets, for one epoch.

    Args:
        frames: (n, 1, H, W); labels: (n,).
        sets: (A, V) indices into the frames; the first column's label is the view set's.
        loss: logits, view logits and labels to a scalar.
    """
    drawn = torch.from_numpy(sets)
    for index in batches(len(sets), batch, order):
        chosen = drawn[index].to(compute.device)
        with compute.autocast():
            logits, view_logits = model(noisy(frames[chosen.flatten()], noise, on_device), sets.shape[1])
        yield loss(logits, view_logits, labels[chosen[:, 0]])


def generators(seed: int, purpose: str, device: torch.device) -> tuple[torch.Generator, torch.Generator]:
    """Two streams of random numbers: one for the order of batches, on the processor, one on the device."""
    order, on_device = torch.Generator(), torch.Generator(device)
    order.manual_seed(torch_seed(seed, f"{purpose}.order"))
    on_device.manual_seed(torch_seed(seed, f"{purpose}.noise"))
    return order, on_device
