"""The number of threads follows the cores that other programs leave free, also during a training.

A step of a small network splits hundreds of products among the threads, and each product waits for the last thread:
where a busy program uses the core of one thread, all others wait.
"""

import os
import time

import torch

FIXED = "OMP_NUM_THREADS"  # the user's own number
FIRST_LOOK, INTERVAL = 0.3, 1.0  # seconds: of the first measurement of the load, and between later ones

used: set[int] = set()  # all numbers of threads of this stage, also those before an interruption


def follow_load() -> None:
    """Set the number of threads now and, once a second, after a step of an optimiser, unless OMP_NUM_THREADS fixes it.

    The number holds for the whole process: call it from a program, not a library.
    """
    if FIXED in os.environ:
        used.add(torch.get_num_threads())
        return
    import psutil  # here, since the package alone does not install it
    from joblib import cpu_count  # respects a container's limit
    from threadpoolctl import threadpool_limits
    from torch.optim.optimizer import register_optimizer_step_post_hook

    process, most, last = psutil.Process(), min(torch.get_num_threads(), cpu_count()), -INTERVAL

    def choose(*_: object) -> None:
        nonlocal last
        if time.monotonic() - last < INTERVAL:
            return
        last = time.monotonic()
        shares, of_process = psutil.cpu_percent(percpu=True), process.cpu_percent()  # since the last call
        cores = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(len(shares))
        threads = free_cores(len(cores), (sum(shares[core] for core in cores) - of_process) / 100, most)
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
    """Number of threads, from 1 to `most`, for `cores` of which other programs use `others`."""
    return min(most, max(1, round(cores - others)))
