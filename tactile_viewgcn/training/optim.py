"""Optimisers, learning-rate schedules and batch counts."""

import math
from functools import partial
from typing import Any

import torch
from torch.optim.lr_scheduler import LambdaLR

from tactile_viewgcn.params import Finetune, Pretrain

MOMENTUM = 0.9  # from the paper's recipe


def num_batches(count: int, size: int) -> int:
    """Return the number of batches for `count` examples, with at most `size` in each.

    Batch normalisation needs two examples. So if a batch would hold a single example, there is one
    batch fewer, and another batch holds one example more than `size`.
    """
    return max(1, min(math.ceil(count / size), count // 2))


def build_optimiser(
    config: Pretrain | Finetune, groups: list[dict[str, Any]]
) -> torch.optim.Optimizer:
    """Return the optimiser of a training run, which is always SGD for pretraining.

    Args:
        config: the section with the learning rate, the weight decay and, for fine-tuning, the
            optimiser.
        groups: groups of weights `params`. A group can have its own learning rate `lr`.
    """
    if isinstance(config, Finetune) and config.optimiser == "adam":
        return torch.optim.Adam(groups, config.lr, weight_decay=config.weight_decay)
    return torch.optim.SGD(groups, config.lr, momentum=MOMENTUM, weight_decay=config.weight_decay)


def build_schedule(config: Pretrain | Finetune, optimiser: torch.optim.Optimizer) -> LambdaLR:
    """Return the schedule that changes the optimiser's learning rates after each epoch."""
    return LambdaLR(optimiser, partial(lr_factor, config))


def lr_factor(config: Pretrain | Finetune, epoch: int) -> float:
    """Return the factor by which the learning rates are multiplied in an epoch.

    Args:
        config: the section with the `schedule` and the number of epochs.
        epoch: number of the epoch, from 0.
    """
    if config.schedule == "constant":
        return 1.0
    if config.schedule == "cosine":
        return _cosine(epoch, config.epochs)
    if config.schedule == "compounding_cosine":  # the paper's released code
        return math.prod(_cosine(earlier, config.epochs) for earlier in range(2, epoch + 1))
    if config.schedule == "exponential":  # Sundaram et al. 2019
        return math.pow(0.1, epoch / 100)
    halvings = (epoch + config.step_offset) // config.step_size
    return math.pow(0.5, halvings)


def _cosine(epoch: int, epochs: int) -> float:
    """Return half a period of a cosine, from 1 before the first epoch to 0 after the last."""
    if epochs == 0:  # the schedule computes its first factor even if there are no epochs
        return 1.0
    return (1 + math.cos(math.pi * epoch / epochs)) / 2
