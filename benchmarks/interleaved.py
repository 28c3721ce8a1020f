"""Interleaved timing: variants of the same work, one after the other, round by round.

What else the machine does then meets all variants alike, and their ratio is taken within a round.
"""

from collections.abc import Callable

import numpy as np
import torch
from torch.utils.benchmark import Timer

BLOCK = 0.2  # seconds that a variant runs in a round, at least


def interleaved(variants: dict[str, Callable[[], object]], rounds: int) -> dict[str, np.ndarray]:
    """Seconds (rounds,) of a call of each variant, the median of as many calls as fill a block.

    A first call in each round warms up, and a device is waited for: see `torch.utils.benchmark`.
    """
    threads = torch.get_num_threads()
    timers = [Timer("variant()", globals={"variant": variant}, num_threads=threads) for variant in variants.values()]
    seconds = [[timer.blocked_autorange(min_run_time=BLOCK).median for timer in timers] for _ in range(rounds)]
    return dict(zip(variants, np.array(seconds).T, strict=True))


def median_ratio(seconds: np.ndarray, other: np.ndarray) -> float:
    """The median over rounds of the ratio within a round."""
    return float(np.median(seconds / other))
