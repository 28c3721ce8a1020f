"""The loop over epochs that both trainings share, and how it ends when a training diverges."""

import math
import time
from collections.abc import Callable, Iterator

import torch
from torch import Tensor
from tqdm import tqdm

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.training import distributed
from tactile_viewgcn.training.checkpoint import Checkpoint, Progress

MAX_BATCH_LOSS, MAX_EPOCH_LOSS = 100.0, 10.0  # times the first loss; a mean loss beyond that has diverged
CHECK_EVERY = 16  # steps between checks of the loss, each of which waits for the device

OnEpoch = Callable[[int, dict[str, float]], None]


class _Diverged(Exception):
    """A mean loss that has diverged, after so many steps of an epoch."""

    def __init__(self, loss: float, steps: int):
        super().__init__(loss)
        self.loss, self.steps = loss, steps


def fit(
    epochs: int,
    optimiser: torch.optim.Optimizer,
    factor: Callable[[int], float],
    losses: Callable[[int], Iterator[Tensor]],
    validate: Callable[[], dict[str, float]],
    bar: tqdm,
    checkpoint: Checkpoint,
    on_epoch: OnEpoch | None = None,
) -> Progress:
    """Run the epochs: a step down each loss, with the learning rates times `factor(epoch)`.

    A training that diverges stops, and the modules get the weights of the last good epoch again. The first loss of an
    epoch shows what the last step of the epoch before did; for the last epoch one more loss is computed.

    Args:
        losses: epoch -> the losses of its batches, one by one; asked once more, for epoch `epochs`, for one loss.
        validate: values to note after an epoch besides the mean loss.
        checkpoint: keeps the training after every epoch; a kept one is continued.
        on_epoch: called after every epoch with its number, from 1, and its values, the mean loss and what `validate`
            gave; first with those of the epochs that the checkpoint holds.

    Returns:
        The values of every epoch, the seconds spent, including those before an interruption, and whether it diverged.

    Raises:
        UserError: it diverges in its first epoch, so that nothing is learnt.
    """
    rates = [group["lr"] for group in optimiser.param_groups]
    progress = checkpoint.restore()
    begin = time.perf_counter() - progress.seconds
    bar.update((bar.total or 0) * progress.epoch // max(1, epochs))
    if on_epoch is not None:
        for epoch in range(progress.epoch):
            on_epoch(epoch + 1, {name: line[epoch] for name, line in progress.curves.items()})
    try:
        for epoch in range(progress.epoch, epochs):
            for group, rate in zip(optimiser.param_groups, rates, strict=True):
                group["lr"] = rate * factor(epoch)
            values = {"loss": _run_epoch(losses(epoch), optimiser, progress, bar)} | validate()
            for name, value in values.items():
                progress.curves.setdefault(name, []).append(value)
            progress.epoch, progress.seconds = epoch + 1, time.perf_counter() - begin
            checkpoint.save(progress)
            bar.set_postfix({name: f"{value:.3f}" for name, value in values.items()})
            if on_epoch is not None:
                on_epoch(progress.epoch, values)
        if epochs:
            _check_last_step(losses(epochs), progress, checkpoint)
    except _Diverged as divergence:
        _return_to_good_epoch(divergence, progress, checkpoint, optimiser)
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
        if progress.first_loss is None:
            progress.first_loss = float(distributed.mean(loss.detach()))
        if steps == 1 or steps % CHECK_EVERY == 0:
            _check(float(distributed.mean(total)) / steps, progress, MAX_BATCH_LOSS, steps)
    mean = float(distributed.mean(total)) / steps
    _check(mean, progress, MAX_EPOCH_LOSS, steps)
    return mean


def _check_last_step(losses: Iterator[Tensor], progress: Progress, checkpoint: Checkpoint) -> None:
    """Compute one loss with the final weights. Raises _Diverged."""
    with torch.no_grad():
        loss = float(distributed.mean(next(losses)))
    checkpoint.restore_weights()  # computing the loss has changed the running moments of batch normalisation
    _check(loss, progress, MAX_BATCH_LOSS, steps=1)


def _check(loss: float, progress: Progress, limit: float, steps: int) -> None:
    if has_diverged(loss, progress, limit):
        raise _Diverged(loss, steps)


def has_diverged(loss: float, progress: Progress, limit: float) -> bool:
    """Whether a mean loss is not finite, or more than `limit` times the very first loss, or `limit` if that is more."""
    return not math.isfinite(loss) or loss > limit * max(1.0, progress.first_loss or 0.0)


def _return_to_good_epoch(
    divergence: _Diverged, progress: Progress, checkpoint: Checkpoint, optimiser: torch.optim.Optimizer
) -> None:
    """Restore the weights from before the epoch that diverged, and note it. UserError where that is the first one."""
    # the first loss of an epoch belongs to the weights that the epoch before left
    good = max(0, progress.epoch - 1) if divergence.steps == 1 else progress.epoch
    rates = ", ".join(f"{group['lr']:g}" for group in optimiser.param_groups)
    progress.diverged = (
        f"training diverged in epoch {good + 1} at a learning rate of {rates}: the loss is {divergence.loss:g}; "
        "lower lr in params.yaml"
    )
    if good < 1:
        raise UserError(progress.diverged)
    checkpoint.restore_weights(progress.epoch - good)
    progress.epoch = good
    progress.curves = {name: line[:good] for name, line in progress.curves.items()}
