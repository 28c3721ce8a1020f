"""The loop over epochs that both trainings share, and how it ends where a training diverges."""

import math
import time
from collections.abc import Callable, Iterator

import torch
from torch import Tensor
from tqdm import tqdm

from tactile_viewgcn.checkpoint import Checkpoint, Progress

FAR, LOST = 100.0, 10.0  # times the first loss: of some batches, and of a whole epoch, that have nothing left to learn
LOOK = 16  # steps from one look at the loss to the next: each look waits for the device


def fit(
    epochs: int,
    optimiser: torch.optim.Optimizer,
    factor: Callable[[int], float],
    losses: Callable[[int], Iterator[Tensor]],
    validate: Callable[[], dict[str, float]],
    bar: tqdm,
    checkpoint: Checkpoint,
) -> Progress:
    """Run the epochs: a step down each loss, with the learning rates times `factor(epoch)`.

    A training that diverges stops within the epoch, and the weights are again those of the last epoch that ended well.
    An epoch's last step is judged by the next one's first loss, that of the last epoch by one loss more.

    Args:
        losses: epoch -> its batches' losses, one by one; of one epoch more than there are, the first is asked for.
        validate: what to note after an epoch besides the mean loss.
        checkpoint: where the training is kept after every epoch, and gone on with if it was.

    Returns:
        The mean loss and what `validate` gave, a value per epoch each, the seconds spent, those before an
        interruption too, and whether it diverged.

    Raises:
        ValueError: it diverges in its first epoch, so that nothing is learnt.
    """
    rates = [group["lr"] for group in optimiser.param_groups]
    progress = checkpoint.restore()
    begin = time.perf_counter() - progress.seconds
    bar.update((bar.total or 0) * progress.epoch // max(1, epochs))
    for epoch in range(progress.epoch, epochs):
        for group, rate in zip(optimiser.param_groups, rates, strict=True):
            group["lr"] = rate * factor(epoch)
        mean, steps, whole = _epoch(losses(epoch), optimiser, progress, bar)
        if not (whole and _fine(mean, progress, LOST)):
            lost = epoch if steps > 1 else max(0, epoch - 1)  # a first loss is that of the weights it began with
            _stop(progress, checkpoint, lost, mean, optimiser)
            break
        for name, value in ({"loss": mean} | validate()).items():
            progress.curves.setdefault(name, []).append(value)
        progress.epoch, progress.seconds = epoch + 1, time.perf_counter() - begin
        checkpoint.save(progress)
        bar.set_postfix({name: f"{line[-1]:.3f}" for name, line in progress.curves.items()})
    if epochs and not progress.diverged:
        with torch.no_grad():
            last = float(next(losses(epochs)))
        checkpoint.go_back()  # the look has moved what batch normalisation remembers
        if not _fine(last, progress, FAR):
            _stop(progress, checkpoint, epochs - 1, last, optimiser)
    progress.seconds = time.perf_counter() - begin
    return progress


def _epoch(
    losses: Iterator[Tensor], optimiser: torch.optim.Optimizer, progress: Progress, bar: tqdm
) -> tuple[float, int, bool]:
    """A step down each loss, until it is seen not to be well: the mean loss, the steps taken, and whether all were."""
    total, count = 0.0, 0
    for count, loss in enumerate(losses, start=1):
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        total = total + loss.detach()
        bar.update()
        if progress.first is None:
            progress.first = float(loss.detach())
        if (count == 1 or not count % LOOK) and not _fine(float(total) / count, progress, FAR):
            return float(total) / count, count, False
    return float(total) / count, count, True


def _fine(loss: float, progress: Progress, times: float) -> bool:
    """Whether a mean loss is a number, and no more than so many times the first loss of all, or 1 if that is more."""
    return loss <= times * max(1.0, progress.first) and math.isfinite(loss)


def _stop(
    progress: Progress, checkpoint: Checkpoint, epoch: int, loss: float, optimiser: torch.optim.Optimizer
) -> None:
    """Go back to the end of the epoch before the one, numbered from 0, that the training diverged in."""
    found = ", ".join(f"{group['lr']:g}" for group in optimiser.param_groups)
    progress.diverged = (
        f"training diverged in epoch {epoch + 1} at a learning rate of {found}: the loss is {loss:g}; lower lr in "
        "params.yaml"
    )
    if epoch < 1:
        raise ValueError(progress.diverged)
    checkpoint.go_back(progress.epoch - epoch)
    progress.epoch = epoch
    progress.curves = {name: line[:epoch] for name, line in progress.curves.items()}
