"""The network input of a table's frames as trainings and trials take it: a tensor, or read batch by batch."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.frame_inputs import FrameInputs
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.tables.stored import StoredCounts

AHEAD = 8  # batches whose frames the system is asked for before they are read
Plan = TypeVar("Plan")
Result = TypeVar("Result")


class StoredInputs:
    """Network input (n, 1, H, W) of frames whose counts stay in their file: what is indexed is read and computed.

    It does what is done with a tensor of frames: `len`, indexing by indices or a slice, `split`.

    Args:
        index: (n,) of the frames.
        transform: another than the table's.
    """

    device = torch.device("cpu")  # of what is read

    def __init__(self, table: Frames, index: np.ndarray, compute: Compute, transform: str | None):
        self._table, self._index, self._compute, self._transform = table, index, compute, transform

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, at: Tensor | slice) -> Any:
        """Network input (k, 1, H, W) of frames at indices (k,), on the processor; of a slice nothing is read yet."""
        if isinstance(at, slice):
            return StoredInputs(self._table, self._index[at], self._compute, self._transform)
        inputs = self._table.inputs(self._index[at.numpy()], self._transform)
        return self._compute.layout(torch.from_numpy(inputs))

    def expect(self, at: Tensor) -> None:
        """Say that the frames at indices (k,) are read next."""
        if isinstance(self._table.counts, StoredCounts):
            self._table.counts.expect(self._index[at.numpy()])

    def split(self, size: int) -> Iterator[Tensor]:
        """The frames in order, `size` at a time."""
        for part in torch.arange(len(self)).split(size):
            yield self[part]


def input_frames(table: Frames, index: np.ndarray, compute: Compute, transform: str | None = None) -> FrameInputs:
    """Network input (n, 1, H, W) of the frames in `index` (n,), on the device if it fits its memory.

    It is read batch by batch where the table's counts stay in their file.

    Args:
        transform: another than the table's.
    """
    if isinstance(table.counts, np.ndarray):
        return compute.frames(torch.from_numpy(table.inputs(index, transform)))
    return StoredInputs(table, index, compute, transform)


def batches(
    frames: FrameInputs, plans: Iterable[Plan], index_of: Callable[[Plan], Tensor], compute: Compute
) -> Iterator[tuple[Plan, Tensor]]:
    """Each plan of a batch, and the frames (B, 1, H, W) of the batch on the device.

    Stored frames are read by a thread, one batch ahead of the one that is computed with, and are asked for earlier.

    Args:
        frames: what `input_frames` returns.
        index_of: the indices (B,) of the frames that a plan needs.
    """
    if not isinstance(frames, StoredInputs):
        for plan in plans:
            yield plan, compute.gather(frames, index_of(plan))
        return
    with ThreadPoolExecutor(1) as thread:
        expected = _started(plans, lambda plan: thread.submit(lambda: frames.expect(index_of(plan))), AHEAD)
        read = _started((plan for plan, _ in expected), lambda plan: thread.submit(lambda: frames[index_of(plan)]), 1)
        for plan, batch in read:
            yield plan, compute.to_device(batch.result())  # not in the thread: a step may be being recorded


def _started(
    plans: Iterable[Plan], start: Callable[[Plan], Future[Result]], ahead: int
) -> Iterator[tuple[Plan, Future[Result]]]:
    """Each plan with what was started for it, `ahead` plans before its turn."""
    started: deque[tuple[Plan, Future[Result]]] = deque()
    for plan in plans:
        started.append((plan, start(plan)))
        if len(started) > ahead:
            yield started.popleft()
    yield from started
