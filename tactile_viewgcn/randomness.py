"""Independent streams of random numbers, all from the one `seed`."""

from zlib import crc32

import numpy as np


def stream(seed: int, purpose: str, *numbers: int) -> np.random.Generator:
    """The generator of one purpose (and trial, say): the same on every run, independent of every other's.

    The purpose comes first and numbers are counted from 1, because NumPy pads a list of seeds with zeros: to it
    [7], [7, 0] and [7, 0, 0] are one stream.
    """
    return np.random.default_rng([crc32(purpose.encode()), seed, *(1 + number for number in numbers)])


def torch_seed(seed: int, purpose: str) -> int:
    """A seed for torch of one purpose."""
    return int(stream(seed, purpose).integers(2**63))
