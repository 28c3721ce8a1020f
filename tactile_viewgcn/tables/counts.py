"""Counts of frames in files: stored in one piece, memory-mapped, and read when they are indexed."""

from collections.abc import Callable, Iterable
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.messages import UserError


def write_blocks(dataset: h5py.Dataset, blocks: Iterable[np.ndarray]) -> None:
    """Fill a dataset (n, H, W) with blocks (k, H, W) that have n frames together."""
    start = 0
    for block in blocks:
        dataset[start : start + len(block)] = block
        start += len(block)


def evenly(index: np.ndarray, most: int) -> np.ndarray:
    """At most `most` of the indices (n,), evenly spaced."""
    return index[np.unique(np.linspace(0, len(index) - 1, most).astype(int))] if len(index) > most else index


class Gathered:
    """An array (n, ...) whose rows are computed when they are indexed: by a slice, by indices or by a mask.

    Args:
        rows_of: function from indices (k,) to rows (k, ...).
        index: (n,) indices of all rows.
    """

    def __init__(self, rows_of: Callable[[np.ndarray], np.ndarray], index: np.ndarray):
        none = rows_of(index[:0])
        self._rows_of, self._index, self.dtype = rows_of, index, none.dtype
        self.shape: tuple[Any, ...] = (len(index), *none.shape[1:])

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, at: slice | np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(self._rows_of(self._index[at]))  # sums round by the order in memory


Counts = np.ndarray | Gathered


def mapped(path: str | Path, dataset: h5py.Dataset) -> Counts:
    """A dataset as an array that the operating system reads from its file page by page, when it is indexed.

    Raises:
        TypeError: the dataset is not stored in one piece.
        UserError: when it is indexed, and the file has become shorter; reading it would end the process.
    """
    if not dataset.size:  # an empty dataset has no place in the file
        return np.asarray(dataset[()])
    if dataset.chunks or (offset := dataset.id.get_offset()) is None:
        raise TypeError(f"{dataset.name} is not stored in one piece")
    with Path(path).open("rb") as file:
        whole = mmap(file.fileno(), 0, access=ACCESS_READ)  # keeps the file open, also where another takes its place
    array = np.frombuffer(whole, dataset.dtype, dataset.size, offset).reshape(dataset.shape)

    def rows_of(index: np.ndarray) -> np.ndarray:
        if whole.size() < len(whole):
            raise UserError(f"{path}: has become shorter while it is read; run `dvc repro` again")
        return array[index]

    return Gathered(rows_of, np.arange(len(array)))
