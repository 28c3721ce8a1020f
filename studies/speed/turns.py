"""Timing works in turn, round by round, so that what else the machine does meets all of them alike."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

Work = Callable[[], float]  # does it once and says how many seconds that took


def clocked(work: Callable[[], object], device: torch.device, repeats: int = 1) -> Work:
    """The mean seconds of some calls of the work, one after another, with all that they leave to the device."""

    def seconds() -> float:
        finish(device)
        begin = time.perf_counter()
        for _ in range(repeats):
            work()
        finish(device)
        return (time.perf_counter() - begin) / repeats

    return seconds


def finish(device: torch.device) -> None:
    """Wait until the device has done what it was given."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def in_turn(works: dict[str, Work], rounds: int, *, warm: bool = True) -> dict[str, np.ndarray]:
    """Seconds (rounds,) of each work: first, second, ..., first, second, ...; an earlier round warms up."""
    taken = {name: [] for name in works}
    for number in range(-1 if warm else 0, rounds):
        for name, work in works.items():
            seconds = work()
            if number >= 0:
                taken[name].append(seconds)
    return {name: np.array(values) for name, values in taken.items()}


@dataclass(frozen=True)
class Pair:
    """Seconds (rounds,) that the same amount of work took on the fast path and on the plain one.

    Attributes:
        fast_work, plain_work: how much of it was done, in any unit, where the two did not do equally much.
    """

    fast: np.ndarray
    plain: np.ndarray
    fast_work: float = 1.0
    plain_work: float = 1.0

    @property
    def each(self) -> tuple[float, float]:
        """Median seconds per unit of work, fast and plain."""
        return float(np.median(self.fast)) / self.fast_work, float(np.median(self.plain)) / self.plain_work

    @property
    def rates(self) -> tuple[float, float]:
        """Units of work a second at the median, fast and plain."""
        fast, plain = self.each
        return 1 / fast, 1 / plain

    @property
    def ratio(self) -> float:
        """How many times as fast the fast path is: the median over rounds of the ratio within a round."""
        return float(np.median((self.plain / self.plain_work) / (self.fast / self.fast_work)))


def share(work: np.ndarray, limit: np.ndarray) -> float:
    """Rate of a work as a share of a limit's, from the seconds (rounds,) each takes for one operation: median."""
    return float(np.median(limit / work))
