"""Counts that stay in their HDF5 file: what is indexed is read."""

import os
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np

from tactile_viewgcn.files import readable
from tactile_viewgcn.memory import fits_memory
from tactile_viewgcn.readers.source import BLOCK_FRAMES

MAX_GAP = 4  # frames that are read for nothing; a read costs as much as decompressing a few


class StoredCounts:
    """Frames (n, H, W) of a dataset, or what some sensors read in them (n, S), indexed along the first axis.

    A slice, indices in any order, or a mask are read into a new array, as of an array. The file stays open as long as
    there is one of these.

    Args:
        path: of the file, for messages.
        dataset: (N, H, W).
        rows: (n,) indices of the frames; None: all.
        sensors: bool (H, W); None: all, and frames keep their shape.
    """

    def __init__(
        self, path: Path, dataset: h5py.Dataset, rows: np.ndarray | None = None, sensors: np.ndarray | None = None
    ):
        self._path, self._dataset, self._rows, self._sensors = path, dataset, rows, sensors
        self.dtype = dataset.dtype
        count = len(dataset if rows is None else rows)
        self.shape = (count, *(dataset.shape[1:] if sensors is None else (int(sensors.sum()),)))

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, at: slice | np.ndarray) -> np.ndarray:
        """Counts (k, H, W) or (k, S) of the frames at a slice, at indices (k,), or where a mask (n,) is True.

        Raises:
            UserError: the file is damaged, or cut short.
        """
        rows = self._rows_at(at)
        if (np.diff(rows) > 0).all():
            return self._read(rows)
        distinct, place = np.unique(rows, return_inverse=True)
        return self._read(distinct)[place]

    def expect(self, at: np.ndarray) -> None:
        """Tell the system that the frames at indices (k,) are read next, so that it fetches them all at once.

        A disk that takes milliseconds for a frame is as quick for many. Frames in chunks are not told.
        """
        first = self._dataset.id.get_offset()  # None: in chunks
        if first is None or not hasattr(os, "posix_fadvise"):
            return
        file, size = self._dataset.file.id.get_vfd_handle(), int(np.prod(self._dataset.shape[1:])) * self.dtype.itemsize
        for row in self._rows_at(at).tolist():
            os.posix_fadvise(file, first + row * size, size, os.POSIX_FADV_WILLNEED)

    def _rows_at(self, at: slice | np.ndarray) -> np.ndarray:
        """Rows (k,) of the dataset at a slice, at indices, or where a mask is True."""
        if isinstance(at, slice):
            at = np.arange(*at.indices(len(self)))
        elif at.dtype == bool:
            at = np.flatnonzero(at)
        return at if self._rows is None else self._rows[at]

    def _read(self, rows: np.ndarray) -> np.ndarray:
        """The counts of rising rows (k,), read in runs."""
        out = np.empty((len(rows), *self.shape[1:]), self.dtype)
        ends = np.flatnonzero(np.diff(rows) > MAX_GAP) + 1
        ends = np.union1d(ends, np.arange(0, len(rows) + BLOCK_FRAMES, BLOCK_FRAMES)).clip(max=len(rows)).tolist()
        with readable(self._path):
            for start, stop in pairwise(ends):
                if start < stop:
                    run = self._dataset[rows[start] : rows[stop - 1] + 1]
                    run = run if len(run) == stop - start else run[rows[start:stop] - rows[start]]
                    out[start:stop] = run if self._sensors is None else run[:, self._sensors]
        return out


Counts = np.ndarray | StoredCounts


def held(counts: StoredCounts, more: int = 0) -> Counts:
    """The counts as an array where it fits memory, else as they are.

    Args:
        more: bytes that are needed beside each count.
    """
    return counts[:] if fits_memory(np.prod(counts.shape) * (counts.dtype.itemsize + more)) else counts
