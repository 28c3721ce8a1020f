"""The loop over epochs that both trainings share.

A training has diverged where the mean loss of an epoch is not finite, or ten times the first loss, or a weight is not
finite.
"""

import math
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from tqdm import tqdm

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import Finetune, Pretrain
from tactile_viewgcn.training.checkpoint import Progress, restore, save
from tactile_viewgcn.training.optim import lr_lambda

MAX_LOSS = 10.0  # largest mean of an epoch, times the first loss or 1, the larger of them
CHECK_EVERY = 16  # steps between checks of the loss, each of which waits for the device

OnEpoch = Callable[[int, dict[str, float]], None]


def error_rate(logits: Tensor, labels: Tensor) -> float:
    """Share of rows whose largest logit is not the label's."""
    return float((logits.argmax(dim=-1) != labels).float().mean())


def fit(
    name: str,
    config: Pretrain | Finetune,
    steps: int,
    optimiser: torch.optim.Optimizer,
    loss_of: Callable[..., Tensor],
    batches: Callable[[int], Iterable[tuple[Tensor, ...]]],
    validate: Callable[[], dict[str, float]],
    parts: dict[str, Any],
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
) -> Progress:
    """Run the epochs: a step down the loss of each batch, at the learning rates of the schedule.

    Args:
        name: of the stage; config: its epochs and schedule; steps: number of batches in an epoch.
        loss_of: the loss of a batch's arguments; batches: epoch -> the arguments of each batch.
        validate: values of an epoch besides the mean loss.
        parts: state besides the optimiser's that a checkpoint keeps, see `save`.
        checkpoint_path: file for the state after every epoch; a saved training is continued.
        on_epoch: called with the number, from 1, and the values of every epoch, those of the checkpoint too.

    Raises:
        UserError: it diverges.
    """
    epochs, factor = config.epochs, lr_lambda(config)
    rates = [group["lr"] for group in optimiser.param_groups]
    parts = parts | {"optimiser": optimiser}
    progress = restore(checkpoint_path, parts)
    begin = time.perf_counter() - progress.seconds
    on_epoch = on_epoch or (lambda *_: None)
    for epoch in range(progress.epoch):
        on_epoch(epoch + 1, {name: line[epoch] for name, line in progress.curves.items()})
    with tqdm(total=epochs * steps, initial=progress.epoch * steps, desc=name, unit="batch", disable=None) as bar:
        for epoch in range(progress.epoch, epochs):
            for group, rate in zip(optimiser.param_groups, rates, strict=True):
                group["lr"] = rate * factor(epoch)
            bar.set_description(f"{name} epoch {epoch + 1}/{epochs}")
            loss = _run_epoch(loss_of, batches(epoch), optimiser, progress, bar)
            weights = (weight for group in optimiser.param_groups for weight in group["params"])
            finite = all(weight.isfinite().all() for weight in weights)  # no loss follows the last step
            if not finite or not math.isfinite(loss) or loss > MAX_LOSS * max(1.0, progress.first_loss or 1.0):
                at = ", ".join(f"{group['lr']:g}" for group in optimiser.param_groups)
                reason = f"the loss is {loss:g}" + ("" if finite else ", and a weight is not finite")
                raise UserError(
                    f"{name} diverged in epoch {epoch + 1} at a learning rate of {at}: {reason}; lower {name}.lr"
                )
            values = {"loss": loss} | validate()
            for key, value in values.items():
                progress.curves.setdefault(key, []).append(value)
            progress.epoch, progress.seconds = epoch + 1, time.perf_counter() - begin
            save(checkpoint_path, parts, progress)
            bar.set_postfix({key: f"{value:.3f}" for key, value in values.items()})
            on_epoch(progress.epoch, values)
    progress.seconds = time.perf_counter() - begin
    return progress


def _run_epoch(
    loss_of: Callable[..., Tensor],
    batches: Iterable[tuple[Tensor, ...]],
    optimiser: torch.optim.Optimizer,
    progress: Progress,
    bar: tqdm,
) -> float:
    """A step down the loss of each batch; the mean loss, before all batches where it is not finite."""
    total, step = torch.zeros(()), 0
    for step, arguments in enumerate(batches, start=1):
        loss = loss_of(*arguments)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        total = total + loss.detach()
        bar.update()
        if progress.first_loss is None:
            progress.first_loss = float(total)
        if step % CHECK_EVERY == 0 and not total.isfinite():
            break
    return float(total) / step
