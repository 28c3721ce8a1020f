"""The loop over epochs that pretraining and fine-tuning share.

A training run has diverged in three cases: the mean loss of an epoch is not finite, it is larger
than both 10 and ten times the first loss, or a weight is not finite.
"""

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.messages import UserError, several
from tactile_viewgcn.params import Finetune, Pretrain
from tactile_viewgcn.progress import progress as shown_progress
from tactile_viewgcn.training.checkpoint import restore, save
from tactile_viewgcn.training.optim import build_schedule
from tactile_viewgcn.training.replay import Replay

MAX_LOSS = 10.0  # largest mean loss of an epoch, as a multiple of the first loss, or of 1 if larger

OnEpoch = Callable[[int, dict[str, float]], None]
Generator = torch.Generator | np.random.Generator


class Training(Protocol):
    """The interface of whatever the loop trains: a loss and its batches."""

    @property
    def loss(self) -> nn.Module:
        """Return the module that computes the loss from a batch's tensors.

        If its attribute `capturable` is False, a GPU does not record it.
        """

    @property
    def steps(self) -> int:
        """Return the number of batches in an epoch."""

    @property
    def generators(self) -> Sequence[Generator]:
        """Return the generators of `batches` that a checkpoint keeps, without torch's defaults."""

    def batches(self, epoch: int) -> Iterable[tuple[Tensor, ...]]:
        """Return the arguments of the loss for each batch of an epoch, numbered from 0."""

    def validate(self) -> dict[str, float]:
        """Return further values of the epoch that has just ended, by name, besides its loss."""


@dataclass
class Progress:
    """How far a training run has come.

    Attributes:
        epoch: number of completed epochs.
        curves: a value for each epoch, by name.
        seconds: run time, including the time before an interruption.
        first_loss: loss of the very first batch, which later losses are compared with.
        resumed: epochs and seconds before the last interruption.
    """

    epoch: int = 0
    curves: dict[str, list[float]] = field(default_factory=dict)
    seconds: float = 0.0
    first_loss: float | None = None
    resumed: tuple[int, float] = (0, 0.0)

    def __str__(self) -> str:
        text = several(self.epoch, "epoch")
        epochs_before = self.resumed[0]
        if epochs_before:
            text += f" ({epochs_before} of them before an interruption)"
        if self.curves:
            last = [f"{name} {values[-1]:.3f}" for name, values in self.curves.items()]
            text += f", at the end {', '.join(last)},"
        return text

    def add_epoch(self, values: dict[str, float]) -> None:
        """Count one more epoch, with these values."""
        for name, value in values.items():
            self.curves.setdefault(name, []).append(value)
        self.epoch += 1

    def values_of(self, epoch: int) -> dict[str, float]:
        """Return the values of a completed epoch, numbered from 0."""
        return {name: values[epoch] for name, values in self.curves.items()}


def error_rate(logits: Tensor, labels: Tensor) -> float:
    """Return the share of rows whose largest logit is at another class than the label.

    Args:
        logits: (n, classes).
        labels: (n,) classes.
    """
    return float((logits.argmax(dim=-1) != labels).float().mean())


def fit(
    stage: str,
    config: Pretrain | Finetune,
    *,
    training: Training,
    optimiser: torch.optim.Optimizer,
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
) -> Progress:
    """Run the epochs: one optimiser step for each batch, at the learning rates of the schedule.

    Args:
        stage: the section of params.yaml that has `config`, for messages.
        config: the number of epochs, and the schedule.
        training: the batches and their loss.
        optimiser: the optimiser, with the learning rates of the first epoch.
        checkpoint_path: file for the state after every epoch. If it exists already, its training
            run is continued.
        on_epoch: function that is called with the number, from 1, and the values of every epoch. It
            is called for the epochs before an interruption too.

    Returns:
        The progress after the last epoch.

    Raises:
        UserError: the training run diverges, or the checkpoint is damaged.
    """
    schedule = build_schedule(config, optimiser)
    capturable = getattr(training.loss, "capturable", True)
    loss_of = Replay(training.loss, _weights(optimiser), records=capturable)
    parts = [training.loss, optimiser, schedule, *training.generators, *_default_generators()]
    progress = Progress()
    if checkpoint_path:
        progress = Progress(**restore(checkpoint_path, parts))
    progress.resumed = (progress.epoch, progress.seconds)
    begin = time.perf_counter() - progress.seconds
    if on_epoch:
        for epoch in range(progress.epoch):
            on_epoch(epoch + 1, progress.values_of(epoch))
    steps = config.epochs * training.steps
    steps_done = progress.epoch * training.steps
    with shown_progress(stage, "batches", steps, done=steps_done) as bar:
        for epoch in range(progress.epoch, config.epochs):
            bar.set_description(f"{stage} epoch {epoch + 1}/{config.epochs}")
            total = _train_epoch(training.batches(epoch), loss_of, optimiser, progress, bar)
            mean = total / training.steps
            _check_converges(stage, mean, progress, optimiser)
            values = {"loss": mean} | training.validate()
            schedule.step()
            progress.add_epoch(values)
            progress.seconds = time.perf_counter() - begin
            if checkpoint_path:
                save(checkpoint_path, parts, vars(progress))
            bar.set_postfix({name: f"{value:.3f}" for name, value in values.items()})
            if on_epoch:
                on_epoch(progress.epoch, values)
    progress.seconds = time.perf_counter() - begin
    return progress


def _train_epoch(
    batches: Iterable[tuple[Tensor, ...]],
    loss_of: Replay,
    optimiser: torch.optim.Optimizer,
    progress: Progress,
    bar: Any,
) -> float:
    """Take a step for each batch, and return the sum of the losses.

    The sum stays on the device until the epoch ends, so that no step waits for it.
    """
    total = torch.zeros(())
    for arguments in batches:
        total = total + loss_of(*arguments)
        optimiser.step()
        bar.update()
        if progress.first_loss is None:
            progress.first_loss = float(total)
    return float(total)


def _default_generators() -> list[torch.Generator]:
    """Return torch's default generators: of the CPU, and of the GPU if one is in use."""
    generators = [torch.default_generator]
    if torch.cuda.is_initialized():  # type: ignore[no-untyped-call]
        generators.append(torch.cuda.default_generators[torch.cuda.current_device()])
    return generators


def _weights(optimiser: torch.optim.Optimizer) -> list[nn.Parameter]:
    """Return the weights that an optimiser changes."""
    weights: list[nn.Parameter] = []
    for group in optimiser.param_groups:
        weights += group["params"]
    return weights


def _check_converges(
    stage: str, mean: float, progress: Progress, optimiser: torch.optim.Optimizer
) -> None:
    """Raise a UserError if the training run has diverged in the epoch that now ends.

    Args:
        stage: section of params.yaml that has the learning rate.
        mean: mean loss of the epoch.
        progress: the progress before this epoch is counted.
        optimiser: the optimiser, for its weights and learning rates.
    """
    # the weights are checked too, since no loss follows the last step
    finite_weights = all(weight.isfinite().all() for weight in _weights(optimiser))
    most = MAX_LOSS * max(1.0, progress.first_loss or 1.0)
    finite_loss = math.isfinite(mean)
    if finite_weights and finite_loss and mean <= most:
        return
    rates = ", ".join(f"{group['lr']:g}" for group in optimiser.param_groups)
    reason = f"the loss is {mean:g}"
    if not finite_weights:
        reason += ", and a weight is not finite"
    raise UserError(
        f"{stage} diverged in epoch {progress.epoch + 1} at a learning rate of {rates}: {reason}; "
        f"lower {stage}.lr"
    )
