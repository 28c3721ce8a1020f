"""Read and write a table's folder, and compute counts when they are indexed.

The folder holds two files. `counts.npy` holds the readings of all frames, uncompressed, so that the
operating system reads it page by page. `columns.npz` holds everything else: arrays as they are, and
all other values as JSON.
"""

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

COUNTS = "counts.npy"
COLUMNS_FILE = "columns.npz"
NO_ARRAYS = "no_arrays"  # the array in columns.npz that holds the JSON


def write_counts(
    folder: Path, shape: tuple[int, ...], dtype: np.dtype, blocks: Iterable[np.ndarray]
) -> None:
    """Write counts block by block, so that only one block is in memory.

    Args:
        folder: the folder of the table.
        shape: (n, H, W) the shape of all counts.
        dtype: the type in which they are stored.
        blocks: the counts (k, H, W) of each block in order, n frames in all.
    """
    header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    with (folder / COUNTS).open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
        for block in blocks:
            file.write(block.astype(dtype).tobytes())


def read_counts(folder: Path) -> np.ndarray:
    """Return the counts (n, H, W), memory-mapped."""
    counts: np.ndarray = np.load(folder / COUNTS, mmap_mode="r", allow_pickle=False)
    return counts.view(np.ndarray)


def write_columns(folder: Path, values: Mapping[str, Any]) -> None:
    """Write values by name: arrays, texts, numbers, and lists and dictionaries of these."""
    arrays: dict[str, Any] = {}
    others: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            arrays[name] = value
        else:
            others[name] = value
    arrays[NO_ARRAYS] = np.frombuffer(json.dumps(others).encode(), np.uint8)
    with (folder / COLUMNS_FILE).open("wb") as file:
        np.savez(file, **arrays)


def read_columns(folder: Path) -> dict[str, Any]:
    """Return the values that `write_columns` wrote, by name."""
    with (folder / COLUMNS_FILE).open("rb") as file, np.load(file, allow_pickle=False) as stored:
        arrays = dict(stored)
    others: dict[str, Any] = json.loads(arrays.pop(NO_ARRAYS).tobytes())
    return arrays | others


def evenly(index: np.ndarray, most: int) -> np.ndarray:
    """Return at most `most` of the indices (n,), evenly spaced."""
    if len(index) <= most:
        return index
    places = np.linspace(0, len(index) - 1, most).astype(int)
    spread: np.ndarray = index[np.unique(places)]
    return spread


def middles(total: int, parts: int) -> np.ndarray:
    """Divide `total` rows into equal parts, and return the middle row int64 (parts,) of each."""
    return ((np.arange(parts) + 0.5) * total / parts).astype(np.int64)


class Gathered:
    """An array (n, ...) whose rows are computed when a slice, indices or a mask asks for them.

    Args:
        rows_of: a function from indices (k,) to rows (k, ...).
        index: (n,) the indices of all rows.

    Attributes:
        shape: (n, ...).
        dtype: the type of the rows.
    """

    def __init__(self, rows_of: Callable[[np.ndarray], np.ndarray], index: np.ndarray):
        self._rows_of = rows_of
        self._index = index
        none = rows_of(index[:0])
        self.dtype = none.dtype
        self.shape: tuple[Any, ...] = (len(index), *none.shape[1:])

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, rows: slice | np.ndarray) -> np.ndarray:
        # contiguous, since the rounding of sums depends on the order in memory
        return np.ascontiguousarray(self._rows_of(self._index[rows]))

    def part(self, rows: np.ndarray) -> "Gathered":
        """Return the rows at the given indices (k,), which are computed in the same way."""
        return Gathered(self._rows_of, self._index[rows])


Counts = np.ndarray | Gathered


def part_of(counts: Counts, rows: np.ndarray) -> Gathered:
    """Return the rows (k, ...) of counts at the given indices (k,), read when they are indexed."""
    if isinstance(counts, Gathered):
        return counts.part(rows)
    return Gathered(counts.__getitem__, rows)
