"""Optimisers, learning-rate schedules and batch counts."""

import math
from collections.abc import Callable

import torch

from tactile_viewgcn.params import Finetune, Pretrain

MOMENTUM = 0.9  # paper


def num_batches(count: int, size: int) -> int:
    """Number of batches for `count` examples, at most `size` in each.

    One batch fewer, with one example more, where a batch would hold a single example: batch
    normalisation needs two.
    """
    return max(1, min(math.ceil(count / size), count // 2))


def build_optimiser(training: Pretrain | Finetune, groups: list[dict]) -> torch.optim.Optimizer:
    """The optimiser of a training; of pretraining always SGD."""
    if isinstance(training, Finetune) and training.optimiser == "adam":
        return torch.optim.Adam(groups, training.lr, weight_decay=training.weight_decay)
    return torch.optim.SGD(
        groups, training.lr, momentum=MOMENTUM, weight_decay=training.weight_decay
    )


def lr_lambda(training: Pretrain | Finetune) -> Callable[[int], float]:
    """Factor on the learning rates in each epoch, numbered from 0, by the `schedule` of a training."""
    if isinstance(training, Pretrain) and training.schedule == "step":
        return lambda epoch: 0.5 ** ((epoch + training.step_offset) // training.step_size)

    def cosine(epoch: int) -> float:
        return (1 + math.cos(math.pi * epoch / training.epochs)) / 2

    return {
        "constant": lambda _: 1.0,
        "cosine": cosine,
        # released code
        "compounding_cosine": lambda epoch: math.prod(map(cosine, range(2, epoch + 1))),
        "exponential": lambda epoch: 0.1 ** (epoch / 100),  # Sundaram et al. 2019
    }[training.schedule]
