"""The loop over epochs that both trainings share.

A training has diverged where the mean loss of an epoch is not finite, or ten times the first loss,
or a weight is not finite.
"""

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.messages import UserError, several
from tactile_viewgcn.params import Finetune, Pretrain
from tactile_viewgcn.progress import progress as shown_progress
from tactile_viewgcn.training.checkpoint import restore, save
from tactile_viewgcn.training.optim import lr_lambda
from tactile_viewgcn.training.replay import Replay

MAX_LOSS = 10.0  # largest mean of an epoch, times the first loss or 1, the larger of them

OnEpoch = Callable[[int, dict[str, float]], None]


@dataclass
class Progress:
    """How far a training has come."""

    epoch: int = 0  # number of epochs done
    curves: dict[str, list[float]] = field(default_factory=dict)  # a value per epoch
    seconds: float = 0.0
    first_loss: float | None = None  # of the very first batch; later losses are compared with it
    resumed: tuple[int, float] = (0, 0.0)  # epochs and seconds before the last interruption

    def __str__(self) -> str:
        before = f" ({self.resumed[0]} of them before an interruption)" if self.resumed[0] else ""
        last = ", ".join(f"{name} {line[-1]:.3f}" for name, line in self.curves.items())
        return f"{several(self.epoch, 'epoch')}{before}" + (f", at the end {last}," if last else "")


def error_rate(logits: Tensor, labels: Tensor) -> float:
    """Share of rows whose largest logit is not the label's."""
    return float((logits.argmax(dim=-1) != labels).float().mean())


def fit(
    stage: str,
    config: Pretrain | Finetune,
    steps: int,
    loss: nn.Module,
    optimiser: torch.optim.Optimizer,
    batches: Callable[[int], Iterable[tuple[Tensor, ...]]],
    validate: Callable[[], dict[str, float]],
    generators: Sequence[torch.Generator | np.random.Generator],
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
) -> Progress:
    """Run the epochs: a step down the loss of each batch, at the learning rates of the schedule.

    Args:
        config: its epochs and schedule; steps: number of batches in an epoch.
        loss: the loss of a batch's arguments; a card does not record it if its attribute
            `capturable` is False.
        batches: epoch -> the arguments of each batch.
        validate: values of an epoch besides the mean loss.
        generators: those of `batches` that a checkpoint keeps, besides torch's default ones.
        checkpoint_path: file for the state after every epoch; a saved training is continued.
        on_epoch: called with the number, from 1, and the values of every epoch, those of the
            checkpoint too.

    Raises:
        UserError: it diverges, or the checkpoint is damaged.
    """
    epochs, factor, rates = (
        config.epochs,
        lr_lambda(config),
        [group["lr"] for group in optimiser.param_groups],
    )
    loss_of = Replay(loss, _weights(optimiser), records=getattr(loss, "capturable", True))
    parts = [loss, optimiser, *generators, torch.default_generator]
    if torch.cuda.is_initialized():
        parts.append(torch.cuda.default_generators[torch.cuda.current_device()])
    progress = Progress(**restore(checkpoint_path, parts) if checkpoint_path else {})
    progress.resumed = progress.epoch, progress.seconds
    begin = time.perf_counter() - progress.seconds
    on_epoch = on_epoch or (lambda *_: None)
    for epoch in range(progress.epoch):
        on_epoch(epoch + 1, {name: line[epoch] for name, line in progress.curves.items()})
    with shown_progress(stage, "batches", epochs * steps, done=progress.epoch * steps) as bar:
        for epoch in range(progress.epoch, epochs):
            for group, rate in zip(optimiser.param_groups, rates, strict=True):
                group["lr"] = rate * factor(epoch)
            bar.set_description(f"{stage} epoch {epoch + 1}/{epochs}")
            total = torch.zeros(())
            for arguments in batches(epoch):
                total = total + loss_of(*arguments)
                optimiser.step()
                bar.update()
                if progress.first_loss is None:
                    progress.first_loss = float(total)
            mean = float(total) / steps
            _check_converges(stage, epoch + 1, mean, progress, optimiser)
            values = {"loss": mean} | validate()
            for key, value in values.items():
                progress.curves.setdefault(key, []).append(value)
            progress.epoch, progress.seconds = epoch + 1, time.perf_counter() - begin
            if checkpoint_path:
                save(checkpoint_path, parts, vars(progress))
            bar.set_postfix({key: f"{value:.3f}" for key, value in values.items()})
            on_epoch(progress.epoch, values)
    progress.seconds = time.perf_counter() - begin
    return progress


def _weights(optimiser: torch.optim.Optimizer) -> list[nn.Parameter]:
    """The weights that an optimiser changes."""
    return [weight for group in optimiser.param_groups for weight in group["params"]]


def _check_converges(
    stage: str, epoch: int, mean: float, progress: Progress, optimiser: torch.optim.Optimizer
) -> None:
    """Raise a UserError if the training has diverged at the end of an epoch with this mean loss."""
    # no loss follows the last step
    finite = all(weight.isfinite().all() for weight in _weights(optimiser))
    if finite and math.isfinite(mean) and mean <= MAX_LOSS * max(1.0, progress.first_loss or 1.0):
        return
    rates = ", ".join(f"{group['lr']:g}" for group in optimiser.param_groups)
    reason = f"the loss is {mean:g}" + ("" if finite else ", and a weight is not finite")
    raise UserError(
        f"{stage} diverged in epoch {epoch} at a learning rate of {rates}: {reason}; lower {stage}.lr"
    )
