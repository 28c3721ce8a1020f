"""The loop over epochs that both trainings share.

A training has diverged where its mean loss is not finite, or many times the first loss; the weights of the last good
epoch are then restored.
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


class _Diverged(Exception):
    """Its arguments are the mean loss, and the number of good epochs before the one that spoilt the weights."""


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

    After the last epoch one more loss is computed, to see that its last step has not spoilt the weights.

    Args:
        name: of the bar that shows the progress; steps: of an epoch.
        losses: epoch -> the losses of its batches, one by one.
        validate: values to note after an epoch besides the mean loss.
        checkpoint: saved after every epoch; a saved training is continued.
        on_epoch: called with the number, from 1, and the values of every epoch, those of the checkpoint too.

    Raises:
        UserError: it diverges in its first epoch, so that nothing is learnt.
    """
    rates = [group["lr"] for group in optimiser.param_groups]
    progress = checkpoint.restore()
    begin = time.perf_counter() - progress.seconds
    on_epoch = on_epoch or (lambda *_: None)
    for epoch in range(progress.epoch):
        on_epoch(epoch + 1, {name: line[epoch] for name, line in progress.curves.items()})
    with tqdm(total=epochs * steps, initial=progress.epoch * steps, desc=name, unit="batch", disable=None) as bar:
        try:
            for epoch in range(progress.epoch, epochs):
                for group, rate in zip(optimiser.param_groups, rates, strict=True):
                    group["lr"] = rate * factor(epoch)
                bar.set_description(f"{name} epoch {epoch + 1}/{epochs}")
                values = {"loss": _run_epoch(losses(epoch), optimiser, progress, bar)} | validate()
                for key, value in values.items():
                    progress.curves.setdefault(key, []).append(value)
                progress.epoch, progress.seconds = epoch + 1, time.perf_counter() - begin
                checkpoint.save(progress)
                bar.set_postfix({key: f"{value:.3f}" for key, value in values.items()})
                on_epoch(progress.epoch, values)
            if epochs:
                with torch.no_grad():
                    loss = float(distributed.mean(next(losses(epochs))))
                checkpoint.restore_weights()  # the loss has changed the running moments of batch normalisation
                _check(loss, MAX_BATCH_LOSS, progress, steps=1)
        except _Diverged as divergence:
            loss, good = divergence.args
            _return_to_good_epoch(loss, good, progress, checkpoint, optimiser)
    progress.seconds = time.perf_counter() - begin
    return progress


def _run_epoch(losses: Iterator[Tensor], optimiser: torch.optim.Optimizer, progress: Progress, bar: tqdm) -> float:
    """A step down each loss; the mean loss. Raises _Diverged."""
    total, steps = torch.zeros(()), 0
    for steps, loss in enumerate(losses, start=1):
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        total = total + loss.detach()
        bar.update()
        if steps == 1 or steps % CHECK_EVERY == 0:
            mean = float(distributed.mean(total)) / steps
            progress.first_loss = mean if progress.first_loss is None else progress.first_loss
            _check(mean, MAX_BATCH_LOSS, progress, steps)
    mean = float(distributed.mean(total)) / steps
    _check(mean, MAX_EPOCH_LOSS, progress, steps)
    return mean


def _check(loss: float, limit: float, progress: Progress, steps: int) -> None:
    """Raises _Diverged for a mean loss that is not finite, or above `limit` times the first loss, or `limit`.

    The loss of the first step of an epoch is of the weights that the epoch before has left.
    """
    if not math.isfinite(loss) or loss > limit * max(1.0, progress.first_loss or 0.0):
        raise _Diverged(loss, max(0, progress.epoch - (steps == 1)))


def _return_to_good_epoch(
    loss: float, good: int, progress: Progress, checkpoint: Checkpoint, optimiser: torch.optim.Optimizer
) -> None:
    """Restore the weights of the last good epoch, and note what happened. UserError where there is none."""
    rates = ", ".join(f"{group['lr']:g}" for group in optimiser.param_groups)
    progress.diverged = (
        f"training diverged in epoch {good + 1} at a learning rate of {rates}: the loss is {loss:g}; "
        "lower lr in params.yaml"
    )
    if not good:
        raise UserError(progress.diverged)
    checkpoint.restore_weights(progress.epoch - good)
    progress.epoch = good
    progress.curves = {name: line[:good] for name, line in progress.curves.items()}
