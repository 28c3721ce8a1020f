"""Optimisers, learning-rate schedules and batch counts."""

import math
from functools import partial
from typing import Any

import torch
from torch.optim.lr_scheduler import LambdaLR

from tactile_viewgcn.params import Finetune, Pretrain

MOMENTUM = 0.9  # of the paper's recipe


def num_batches(count: int, size: int) -> int:
    """Return the number of batches for `count` examples, at most `size` in each.

    One batch fewer, with one example more, where a batch would hold a single example: batch
    normalisation needs two.
    """
    return max(1, min(math.ceil(count / size), count // 2))


def build_optimiser(
    config: Pretrain | Finetune, groups: list[dict[str, Any]]
) -> torch.optim.Optimizer:
    """Return the optimiser of a training run; pretraining always has SGD.

    Args:
        config: its learning rate, weight decay and, of fine-tuning, its optimiser.
        groups: `params`, the weights, and `lr`, their own learning rate, if any.
    """
    if isinstance(config, Finetune) and config.optimiser == "adam":
        return torch.optim.Adam(groups, config.lr, weight_decay=config.weight_decay)
    return torch.optim.SGD(groups, config.lr, momentum=MOMENTUM, weight_decay=config.weight_decay)


def build_schedule(config: Pretrain | Finetune, optimiser: torch.optim.Optimizer) -> LambdaLR:
    """Return the schedule that changes the optimiser's learning rates after each epoch."""
    return LambdaLR(optimiser, partial(lr_factor, config))


def lr_factor(config: Pretrain | Finetune, epoch: int) -> float:
    """Return the factor on the learning rates in an epoch.

    Args:
        config: its `schedule` and number of epochs.
        epoch: number of the epoch, from 0.
    """
    if config.schedule == "constant":
        return 1.0
    if config.schedule == "cosine":
        return _cosine(epoch, config.epochs)
    if config.schedule == "compounding_cosine":  # code that was released with the paper
        return math.prod(_cosine(earlier, config.epochs) for earlier in range(2, epoch + 1))
    if config.schedule == "exponential":  # Sundaram et al. 2019
        return math.pow(0.1, epoch / 100)
    halvings = (epoch + config.step_offset) // config.step_size
    return math.pow(0.5, halvings)


def _cosine(epoch: int, epochs: int) -> float:
    """Return half a period of a cosine, from 1 before the first epoch to 0 after the last."""
    if epochs == 0:  # the schedule computes its first factor for no epoch too
        return 1.0
    return (1 + math.cos(math.pi * epoch / epochs)) / 2
