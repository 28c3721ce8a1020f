"""Training by the processes that `torchrun` starts, with torch's DistributedDataParallel.

Every process draws noise, shifts and view sets of the whole batch, then takes its rows of it. Gradients and losses are
means over the processes. On CUDA batch normalisation is over the whole batch; on the processor it is over the rows, and
running moments are those of the first process. One process communicates nothing.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta

import torch
import torch.distributed as dist
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.process import LOST, launched

TIMEOUT = timedelta(minutes=10)  # for one process to wait for another, which then counts as lost


@contextmanager
def process_group(compute: Compute) -> Iterator[None]:
    """Context in which the processes of `torchrun` train together, each on its own CUDA device.

    Raises:
        UserError: more processes than CUDA devices; a process is lost.
    """
    if not launched():
        yield
        return
    backend, device = "gloo", None
    if compute.device.type == "cuda":
        backend, device = "nccl", torch.device("cuda", int(os.environ["LOCAL_RANK"]))
        if device.index >= torch.cuda.device_count():
            raise UserError(f"launcher: {torch.cuda.device_count()} CUDA devices; lower --nproc-per-node to that")
        torch.cuda.set_device(device)
    try:
        dist.init_process_group(backend, timeout=TIMEOUT, device_id=device)
        yield
        dist.destroy_process_group()
    except RuntimeError as error:
        if not isinstance(error, dist.DistError) and "gloo" not in str(error).lower():
            raise
        raise UserError(LOST) from error


def size() -> int:
    """Number of processes that train together."""
    return dist.get_world_size() if dist.is_initialized() else 1


def rows(count: int) -> slice:
    """This process's rows of a batch of `count` examples; the processes' parts differ by one example at most.

    Gradients are the mean over processes, so an example of a smaller part weighs a little more.

    Raises:
        UserError: fewer than two examples for a process, which batch normalisation needs.
    """
    if size() == 1:
        return slice(0, count)
    if count < 2 * size():
        raise UserError(f"a batch of {count} for {size()} processes; expected two each: raise batch, or start fewer")
    return slice(*(count * (dist.get_rank() + end) // size() for end in (0, 1)))


def mean(value: Tensor) -> float:
    """Mean over the processes."""
    total = value.detach().clone()
    if size() > 1:
        dist.all_reduce(total)
    return float(total) / size()


def parallel(loss: nn.Module, *, some_unused: bool = False) -> nn.Module:
    """The loss in torch's DistributedDataParallel, if processes train together.

    Args:
        some_unused: not every batch uses all weights.
    """
    if size() == 1:
        return loss
    if dist.get_rank():  # each process draws its own dropout
        torch.manual_seed(torch.initial_seed() + dist.get_rank())
    if next(loss.parameters()).device.type == "cuda":
        loss = nn.SyncBatchNorm.convert_sync_batchnorm(loss)
    return nn.parallel.DistributedDataParallel(loss, find_unused_parameters=some_unused)
