"""Training by the processes that `torchrun` starts: each computes the loss of its rows of every batch.

Every process draws noise, shifts and view sets of the whole batch and takes its rows, and draws dropout for these. On
CUDA batch normalisation is over the whole batch. On the processor it is over the rows, and running moments are those of
the first process. One process communicates nothing.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta

import torch
import torch.distributed as dist
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.process import LOST, launched

TIMEOUT = timedelta(minutes=10)  # for one process to wait for another, which then counts as lost


@contextmanager
def process_group(compute: Compute) -> Iterator[None]:
    """Context in which the processes of `torchrun` train together, each on a CUDA device of its own.

    Raises:
        UserError: more processes than CUDA devices; another process is lost.
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
    """This process's rows of a batch of `count` examples; the parts differ by one example at most.

    Raises:
        UserError: fewer than two examples for a process, which batch normalisation needs.
    """
    parts, number = size(), dist.get_rank() if dist.is_initialized() else 0
    if parts > 1 and count < 2 * parts:
        raise UserError(f"a batch of {count} for {parts} processes; expected two each: raise batch, or start fewer")
    return slice(count * number // parts, count * (number + 1) // parts)


def weighted(loss: Tensor, count: int) -> Tensor:
    """The mean loss of this process's rows of a batch of `count`, scaled: its mean over processes is the batch's."""
    part = rows(count)
    return loss * ((part.stop - part.start) * size() / count) if size() > 1 else loss


def total(values: Tensor) -> Tensor:
    """Sum over the processes, without a gradient."""
    if size() == 1:
        return values.detach()
    values = values.detach().clone()
    dist.all_reduce(values)
    return values


def gather(values: Tensor, count: int) -> Tensor:
    """Values (count, ...) of the whole batch, without a gradient, from each process's values of its `rows`."""
    if size() == 1:
        return values.detach()
    whole = values.new_zeros((count, *values.shape[1:]))
    whole[rows(count)] = values.detach()
    return total(whole)


def parallel(loss: nn.Module, *, some_unused: bool = False) -> nn.Module:
    """The loss in torch's DistributedDataParallel, if processes train together.

    `some_unused`: not every batch uses all weights.
    """
    if not dist.is_initialized():
        return loss
    if dist.get_rank():  # each process draws its own dropout
        torch.manual_seed(torch.initial_seed() + dist.get_rank())
    if next(loss.parameters()).device.type == "cuda":
        loss = nn.SyncBatchNorm.convert_sync_batchnorm(loss)
    return nn.parallel.DistributedDataParallel(loss, find_unused_parameters=some_unused)
