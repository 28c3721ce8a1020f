"""Training by the processes that `torchrun` starts: each computes the loss of its part of every batch.

Every process draws noise, shifts and view sets of the whole batch and takes its rows, and draws dropout for these. On
CUDA batch normalisation is over the whole batch. On the processor it is over the part, and running moments are those of
the first process. Where one process trains alone, nothing is communicated.
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
def process_group(compute: Compute, alone: bool = False) -> Iterator[None]:
    """Context in which the processes of `torchrun` train together, unless `alone`, each on a CUDA device of its own.

    Raises:
        UserError: more processes than CUDA devices; another process is lost.
    """
    if alone or not launched():
        yield
        return
    backend, device = "gloo", None
    if compute.device.type == "cuda":
        number, devices = int(os.environ["LOCAL_RANK"]), torch.cuda.device_count()
        if number >= devices:
            raise UserError(
                f"launcher starts more than {number} processes here, and torch sees {devices} CUDA devices; "
                f"expected --nproc-per-node {devices}, or device: cpu"
            )
        torch.cuda.set_device(number)
        backend, device = "nccl", torch.device("cuda", number)
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


def wait_for_all() -> None:
    """Return once every process is here."""
    if dist.is_initialized():
        dist.barrier()


def rows(count: int) -> slice:
    """This process's part of a batch of `count` examples; parts differ by one example at most.

    Raises:
        UserError: fewer than two examples for a process, which batch normalisation needs.
    """
    if not dist.is_initialized():
        return slice(0, count)
    parts, number = dist.get_world_size(), dist.get_rank()
    if parts > 1 and count < 2 * parts:
        raise UserError(
            f"a batch holds {count} examples and launcher starts {parts} processes; expected two examples for each: "
            "lower --nproc-per-node, or raise batch"
        )
    return slice(count * number // parts, count * (number + 1) // parts)


def weighted(loss: Tensor, count: int) -> Tensor:
    """The mean loss of this process's part of a batch of `count`, scaled: its mean over processes is the batch's."""
    part = rows(count)
    return loss * ((part.stop - part.start) * size() / count) if dist.is_initialized() else loss


def gather(values: Tensor, count: int) -> Tensor:
    """Values (count, ...) of the whole batch, without a gradient, from each process's values of its `rows`."""
    if not dist.is_initialized():
        return values.detach()
    whole = values.new_zeros((count, *values.shape[1:]))
    whole[rows(count)] = values.detach()
    dist.all_reduce(whole)
    return whole


def take_first(values: Tensor) -> None:
    """Replace the values by those of the first process."""
    if dist.is_initialized():
        dist.broadcast(values, 0)


def mean(value: Tensor) -> Tensor:
    """Mean over the processes."""
    if dist.is_initialized():
        value = value.clone()
        dist.all_reduce(value)
        value /= size()
    return value


def parallel(loss: nn.Module, *, some_unused: bool = False) -> nn.Module:
    """The loss in torch's DistributedDataParallel, if processes train together.

    `some_unused`: not every batch uses all weights.
    """
    if not dist.is_initialized():
        return loss
    if dist.get_rank():  # the dropout of each part is another
        torch.manual_seed(torch.initial_seed() + dist.get_rank())
    if next(loss.parameters()).device.type == "cuda":
        loss = nn.SyncBatchNorm.convert_sync_batchnorm(loss)
    return nn.parallel.DistributedDataParallel(loss, find_unused_parameters=some_unused)
