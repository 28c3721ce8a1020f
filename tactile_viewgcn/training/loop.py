"""The loop over epochs that both trainings share.

A training has diverged where its mean loss is not finite, or many times the first loss, or a weight is not finite.
"""

import math
import time
from collections.abc import Callable, Iterator

import torch
from torch import Tensor
from tqdm import tqdm

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.training import distributed
from tactile_viewgcn.training.checkpoint import Checkpoint, Progress

MAX_BATCH_LOSS, MAX_EPOCH_LOSS = 100.0, 10.0  # times the first loss, or these where it is below 1
CHECK_EVERY = 16  # steps between checks of the loss, each of which waits for the device

OnEpoch = Callable[[int, dict[str, float]], None]


def fit(
    name: str,
    epochs: int,
    steps: int,
    optimiser: torch.optim.Optimizer,
    factor: Callable[[int], float],
    losses: Callable[[int], Iterator[Tensor]],
    validate: Callable[[], dict[str, float]],
    checkpoint: Checkpoint,
    on_epoch: OnEpoch | None = None,
) -> Progress:
    """Run the epochs: a step down each loss, with the learning rates times `factor(epoch)`.

    Args:
        name: of the stage; steps: of an epoch.
        losses: epoch -> the losses of its batches, one by one.
        validate: values to note after an epoch besides the mean loss.
        checkpoint: saved after every epoch; a saved training is continued.
        on_epoch: called with the number, from 1, and the values of every epoch, those of the checkpoint too.

    Raises:
        UserError: it diverges.
    """
    rates = [group["lr"] for group in optimiser.param_groups]
    progress = checkpoint.restore()
    begin = time.perf_counter() - progress.seconds
    on_epoch = on_epoch or (lambda *_: None)
    for epoch in range(progress.epoch):
        on_epoch(epoch + 1, {name: line[epoch] for name, line in progress.curves.items()})
    with tqdm(total=epochs * steps, initial=progress.epoch * steps, desc=name, unit="batch", disable=None) as bar:
        for epoch in range(progress.epoch, epochs):
            for group, rate in zip(optimiser.param_groups, rates, strict=True):
                group["lr"] = rate * factor(epoch)
            bar.set_description(f"{name} epoch {epoch + 1}/{epochs}")
            values = {"loss": _run_epoch(name, losses(epoch), optimiser, progress, bar)} | validate()
            for key, value in values.items():
                progress.curves.setdefault(key, []).append(value)
            progress.epoch, progress.seconds = epoch + 1, time.perf_counter() - begin
            checkpoint.save(progress)
            bar.set_postfix({key: f"{value:.3f}" for key, value in values.items()})
            on_epoch(progress.epoch, values)
    progress.seconds = time.perf_counter() - begin
    return progress


def _run_epoch(
    name: str, losses: Iterator[Tensor], optimiser: torch.optim.Optimizer, progress: Progress, bar: tqdm
) -> float:
    """A step down each loss; the mean loss.

    Raises:
        UserError: it diverges.
    """
    total, steps = torch.zeros(()), 0

    def mean(limit: float) -> float:
        """Mean loss so far. UserError where it is not finite, or above `limit` times the first loss, or `limit`."""
        loss = float(distributed.total(total)) / distributed.size() / steps
        progress.first_loss = loss if progress.first_loss is None else progress.first_loss
        if not math.isfinite(loss) or loss > limit * max(1.0, progress.first_loss):
            raise diverged(f"the loss is {loss:g}")
        return loss

    def diverged(found: str) -> UserError:
        rates = ", ".join(f"{group['lr']:g}" for group in optimiser.param_groups)
        epoch = progress.epoch + 1
        return UserError(f"{name} diverged in epoch {epoch} at a learning rate of {rates}: {found}; lower {name}.lr")

    for steps, loss in enumerate(losses, start=1):
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        total = total + loss.detach()
        bar.update()
        if steps == 1 or steps % CHECK_EVERY == 0:
            mean(MAX_BATCH_LOSS)
    last = mean(MAX_EPOCH_LOSS)
    if not all(weight.isfinite().all() for group in optimiser.param_groups for weight in group["params"]):
        raise diverged("a weight is not finite")  # by the last step, after which no loss is computed
    return last
