"""A table's folder, counts.npy and columns.npz, and counts that are computed when they are indexed.

`counts.npy` holds the readings of all frames uncompressed, so that the operating system reads it
page by page; `columns.npz` holds all else: arrays, and as JSON what is no array.
"""

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

COUNTS, COLUMNS = "counts.npy", "columns.npz"
NO_ARRAYS = "no_arrays"  # the array in columns.npz with the JSON


def write_counts(
    folder: Path, shape: tuple[int, ...], dtype: np.dtype, blocks: Iterable[np.ndarray]
) -> None:
    """Write counts (n, H, W) of that shape and type, of which only one block (k, H, W) need be in memory."""
    header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    with (folder / COUNTS).open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
        for block in blocks:
            file.write(block.astype(dtype).tobytes())


def read_counts(folder: Path) -> np.ndarray:
    """The counts (n, H, W), memory-mapped."""
    return np.load(folder / COUNTS, mmap_mode="r", allow_pickle=False).view(np.ndarray)


def write_columns(folder: Path, values: Mapping[str, Any]) -> None:
    """Write arrays, and texts, numbers, lists and dictionaries of these, by name."""
    arrays: dict[str, Any] = {
        name: value for name, value in values.items() if isinstance(value, np.ndarray)
    }
    others = json.dumps({name: value for name, value in values.items() if name not in arrays})
    arrays[NO_ARRAYS] = np.frombuffer(others.encode(), np.uint8)
    with (folder / COLUMNS).open("wb") as file:
        np.savez(file, **arrays)


def read_columns(folder: Path) -> dict[str, Any]:
    """The values that `write_columns` wrote, by name."""
    with (folder / COLUMNS).open("rb") as file, np.load(file, allow_pickle=False) as stored:
        arrays = dict(stored)
    others = arrays.pop(NO_ARRAYS)
    return arrays | json.loads(others.tobytes())


def evenly(index: np.ndarray, most: int) -> np.ndarray:
    """At most `most` of the indices (n,), evenly spaced."""
    return (
        index[np.unique(np.linspace(0, len(index) - 1, most).astype(int))]
        if len(index) > most
        else index
    )


def middles(total: int, parts: int) -> np.ndarray:
    """Return the index int64 (parts,) in the middle of each of equal parts of `total` rows."""
    return ((np.arange(parts) + 0.5) * total / parts).astype(np.int64)


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
        # sums round by the order in memory
        return np.ascontiguousarray(self._rows_of(self._index[at]))


Counts = np.ndarray | Gathered
