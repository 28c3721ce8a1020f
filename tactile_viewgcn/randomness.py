"""Makes independent streams of random numbers from a seed and the purpose of the numbers.

`seed` of params.yaml is the seed of clustering, training and evaluation. Another `seed` does not
change the data: anchors and validation groups have the fixed seed `SPLIT_SEED`, a shuffle of the
folds has `split.deal`, and the virtual glove has `glove.seed`.
"""

from typing import TYPE_CHECKING
from zlib import crc32

import numpy as np

if TYPE_CHECKING:
    import torch


def stream(seed: int, purpose: str, *numbers: int) -> np.random.Generator:
    """Return a generator for one purpose, independent of all others.

    The purpose comes first and the numbers count from 1, because NumPy pads a list of seeds with
    zeros: [7], [7, 0] and [7, 0, 0] give the same stream. Never change the text of a purpose, since
    another text gives other random numbers.

    Args:
        seed: see the top of this module.
        purpose: a text that no other purpose has.
        *numbers: numbers of the trial or fold, if each has its own generator.
    """
    counted_from_1 = [1 + number for number in numbers]
    return np.random.default_rng([crc32(purpose.encode()), seed, *counted_from_1])


def torch_seed(seed: int, purpose: str) -> int:
    """Return a seed for torch, below 2^63, for one purpose; see `stream` for the arguments."""
    return int(stream(seed, purpose).integers(2**63))


def torch_generator(
    seed: int, purpose: str, device: "torch.device | str" = "cpu"
) -> "torch.Generator":
    """Return a torch generator for one purpose on a device; see `stream` for the arguments."""
    import torch

    return torch.Generator(device).manual_seed(torch_seed(seed, purpose))
