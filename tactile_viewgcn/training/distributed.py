"""Training by several processes: each computes a part of every batch, and all take the same steps.

`torchrun` starts them. Every process draws the random numbers of the whole batch, so that it is the batch that one
process would draw. Where one process trains alone, it has all of a batch, and nothing is communicated.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from itertools import pairwise

import torch
import torch.distributed as dist
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.process import LOST, launched
from tactile_viewgcn.training.inputs import FrameInputs

TIMEOUT = timedelta(minutes=10)  # for one process to wait for another, which then counts as lost
_sizes = [1]  # how many examples of the latest batch each process has, see `rows`


@contextmanager
def joined(compute: Compute, alone: bool = False) -> Iterator[None]:
    """Context in which the processes that `torchrun` started train together; each has a CUDA device of its own.

    Args:
        alone: this process does the work alone.

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


def together() -> bool:
    """Whether processes train together here; one that `torchrun` started alone does all that several do."""
    return dist.is_initialized()


def size() -> int:
    """Number of processes that train together."""
    return dist.get_world_size() if together() else 1


def wait_for_all() -> None:
    """Return once every process is here."""
    if together():
        dist.barrier()


def rows(count: int) -> slice:
    """The examples of a batch of `count` that this process computes; parts differ by one example at most.

    The layers of `whole_batch` and the functions below refer to the latest batch that was divided.

    Raises:
        UserError: fewer examples than processes.
    """
    parts = size()
    if count < parts:
        raise UserError(
            f"a batch holds {count} examples and launcher starts {parts} processes; expected an example for each: "
            "lower --nproc-per-node, or raise batch"
        )
    ends = [count * number // parts for number in range(parts + 1)]
    _sizes[:] = [end - start for start, end in pairwise(ends)]
    number = dist.get_rank() if together() else 0
    return slice(ends[number], ends[number + 1])


def place(own: int) -> tuple[slice, int]:
    """Where the `own` rows that this process has of the batch stand among those of all, and how many these are.

    An example may have several rows, as many as every other.
    """
    number = dist.get_rank()
    each, before = own // _sizes[number], sum(_sizes[:number])
    return slice(before * each, (before + _sizes[number]) * each), sum(_sizes) * each


def shares(like: Tensor) -> Tensor:
    """Share of the batch that each process has, (processes,)."""
    return like.new_tensor(_sizes) / sum(_sizes)


def of_each(values: Tensor) -> list[Tensor]:
    """The tensor that each process gives, all of one shape."""
    parts = [torch.empty_like(values) for _ in range(size())]
    dist.all_gather(parts, values)
    return parts


def gather(values: Tensor) -> Tensor:
    """Rows (n, ...) of the whole batch, without a gradient, from the rows that each process gives."""
    values = values.detach()
    if not together():
        return values
    each = len(values) // _sizes[dist.get_rank()]
    most = max(_sizes) * each
    padded = torch.cat([values, values.new_zeros(most - len(values), *values.shape[1:])]).contiguous()
    return torch.cat([part[: own * each] for part, own in zip(of_each(padded), _sizes, strict=True)])


def in_parts(function: Callable[[FrameInputs | Tensor], Tensor], values: FrameInputs) -> Tensor:
    """function(values), row by row; each process computes its part of the rows."""
    if not together() or len(values) < size():
        return function(values)
    part = rows(len(values))
    return gather(function(values[torch.arange(part.start, part.stop)]))


def mean(values: Tensor) -> Tensor:
    """Mean over the processes."""
    if together():
        values = values.clone()
        dist.all_reduce(values)
        values /= size()
    return values


class _Reduced(nn.Module):
    """Holds what is trained, for DistributedDataParallel, which reduces its gradients once the loss has passed."""

    def __init__(self, trained: nn.Module):
        super().__init__()
        self.weights = nn.ParameterList(trained.parameters())

    def forward(self, loss: Tensor) -> Tensor:
        return loss


def joint_loss(trained: nn.Module, *, some_unused: bool = False) -> Callable[[Tensor], Tensor]:
    """A function of the mean loss of a part, whose gradients are then those of the whole batch on every process.

    The mean over the processes of what it gives is the mean loss of the batch.

    Args:
        some_unused: not every batch uses all weights.
    """
    if not together():
        return lambda loss: loss
    reduced = nn.parallel.DistributedDataParallel(_Reduced(trained), find_unused_parameters=some_unused)
    return lambda loss: reduced(loss * (_sizes[dist.get_rank()] * size() / sum(_sizes)))
