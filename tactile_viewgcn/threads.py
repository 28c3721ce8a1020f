"""The number of threads: as many as other programs leave cores for, looked at while a training goes on.

A step of a small network shares hundreds of products out to the threads, and each waits for the last thread: beside a
busy program for one whose core that program has.
"""

import os
import time

import torch

FIXED = "OMP_NUM_THREADS"  # the user's own number, or torchrun's
FIRST_LOOK, INTERVAL = 0.3, 1.0  # seconds: of the look before a training, between those in it

used: set[int] = set()  # numbers of threads of this stage, those before an interruption too


def follow_load() -> None:
    """Choose the number of threads now and, once a second, after a step of an optimiser; leave one that is fixed.

    It holds for the whole process: call it from a program, not a library.
    """
    if FIXED in os.environ:
        used.add(torch.get_num_threads())
        return
    import psutil  # here: not installed with the package alone
    from joblib import cpu_count  # heeds a container's limit
    from threadpoolctl import threadpool_limits
    from torch.optim.optimizer import register_optimizer_step_post_hook

    process, most, last = psutil.Process(), min(torch.get_num_threads(), cpu_count()), -INTERVAL

    def choose(*_: object) -> None:
        nonlocal last
        if time.monotonic() - last < INTERVAL:
            return
        last, shares, own = time.monotonic(), psutil.cpu_percent(percpu=True), process.cpu_percent()  # since last time
        cores = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(len(shares))
        threads = free_cores(len(cores), (sum(shares[core] for core in cores) - own) / 100, most)
        if threads != torch.get_num_threads():
            torch.set_num_threads(threads)
            threadpool_limits(threads)
        used.add(threads)

    psutil.cpu_percent(percpu=True)
    process.cpu_percent()
    time.sleep(FIRST_LOOK)
    choose()
    register_optimizer_step_post_hook(choose)


def free_cores(cores: int, others: float, most: int) -> int:
    """Number of cores that other programs leave, from 1 to `most`; they use `others` of so many."""
    return min(most, max(1, round(cores - others)))
