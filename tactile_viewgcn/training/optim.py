"""Optimisers, learning-rate schedules and batch counts."""

import math
from collections.abc import Callable

import torch

from tactile_viewgcn.params import Finetune, Pretrain

MOMENTUM = 0.9  # paper


def num_batches(count: int, size: int) -> int:
    """Number of batches for `count` examples, at most `size` in each.

    One batch fewer, with one example more, where a batch would hold a single example: batch normalisation needs two.
    """
    return max(1, min(math.ceil(count / size), count // 2))


def build_optimiser(training: Pretrain | Finetune, groups: list[dict]) -> torch.optim.Optimizer:
    """The optimiser of a training; of pretraining always SGD."""
    if isinstance(training, Finetune) and training.optimiser == "adam":
        return torch.optim.Adam(groups, training.lr, weight_decay=training.weight_decay)
    return torch.optim.SGD(groups, training.lr, momentum=MOMENTUM, weight_decay=training.weight_decay)


def lr_lambda(training: Pretrain | Finetune) -> Callable[[int], float]:
    """Factor on the learning rates in each epoch, numbered from 0, by the `schedule` of a training."""
    if isinstance(training, Pretrain) and training.schedule == "step":
        return lambda epoch: step_decay(epoch, step_size=training.step_size, offset=training.step_offset)
    return {
        "constant": lambda _: 1.0,
        "compounding_cosine": lambda epoch: compounding_cosine(epoch, epochs=training.epochs),
        "cosine": lambda epoch: (1 + math.cos(math.pi * epoch / training.epochs)) / 2,
        "exponential": lambda epoch: 0.1 ** (epoch / 100),  # Sundaram et al. 2019
    }[training.schedule]


def step_decay(epoch: int, *, step_size: int, offset: int = 0) -> float:
    """Factor on the learning rate that halves every `step_size` epochs, each halving `offset` epochs earlier."""
    return 0.5 ** ((epoch + offset) // step_size)


def compounding_cosine(epoch: int, *, epochs: int) -> float:
    """The released code's fine-tuning schedule: from epoch 2 on, (1 + cos(pi e / epochs)) / 2, multiplied up."""
    return math.prod((1 + math.cos(math.pi * e / epochs)) / 2 for e in range(2, epoch + 1))
