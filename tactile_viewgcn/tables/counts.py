"""Counts of frames in files: stored in one piece, memory-mapped, and read when they are indexed."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np


def write_blocks(dataset: h5py.Dataset, blocks: Iterable[np.ndarray]) -> None:
    """Fill a dataset (n, H, W) with blocks (k, H, W) that have n frames together."""
    start = 0
    for block in blocks:
        dataset[start : start + len(block)] = block
        start += len(block)


def mapped(path: str | Path | BinaryIO, dataset: h5py.Dataset) -> np.ndarray:
    """A dataset as an array that the operating system reads from its file page by page.

    Args:
        path: of the file; a stream, which cannot be mapped, is read whole.

    Raises:
        TypeError: the dataset is not stored in one piece.
    """
    if not isinstance(path, str | Path) or not dataset.size:  # an empty dataset has no place in the file
        return np.asarray(dataset[()])
    if dataset.chunks or dataset.id.get_offset() is None:
        raise TypeError(f"{dataset.name} is not stored in one piece")
    return np.asarray(np.memmap(path, dataset.dtype, "r", dataset.id.get_offset(), dataset.shape))


class Gathered:
    """An array (n, ...) whose rows are computed when they are indexed: by a slice, by indices or by a mask.

    Args:
        rows_of: function from indices (k,) to rows (k, ...).
        index: (n,) indices of all rows.
        shape: of a row.
        dtype: of the rows.
    """

    def __init__(
        self, rows_of: Callable[[np.ndarray], np.ndarray], index: np.ndarray, shape: tuple[int, ...], dtype: np.dtype
    ):
        self._rows_of, self._index, self.dtype = rows_of, index, dtype
        self.shape: tuple[Any, ...] = (len(index), *shape)

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, at: slice | np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(self._rows_of(self._index[at]))  # sums round by the order in memory


Counts = np.ndarray | Gathered
