"""Write the file of counts while a source is read: frames first, and the header last."""

from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from tactile_viewgcn.readers.source import BLOCK_FRAMES, first_unfit, limits
from tactile_viewgcn.tables.counts import COUNTS

ENDLESS = np.dtype(np.float64)  # for integers that are too large for a table of integers


@dataclass(frozen=True)
class Fault:
    """A reading or a value of a column that is out of range.

    Attributes:
        column: `pressure`, or the name of a column.
        row: the number of its frame among all frames.
        value: the first value of that frame that is out of range.
        low: the smallest value that is in range.
        high: the largest value that is in range.
        is_whole: whether fractions are out of range too.
    """

    column: str
    row: int
    value: float
    low: float
    high: float
    is_whole: bool


class CountsFile:
    """The counts of all frames in a table's folder, of which one block is in memory at a time.

    The file has the widest type of the recordings so far. If a later recording has a wider type,
    the file is written again.

    Args:
        folder: the folder of the table.

    Attributes:
        frames: the number of frames that are written.
        shape: (H, W) the shape of a frame; None before the first recording.
        dtype: the type of the file.
        dtypes: the types of the recordings.
        low: (H, W) the smallest reading of each sensor so far.
        high: (H, W) the largest reading of each sensor so far.
        fault: the first reading out of range, if there is one.
        integer_fault: the first integer that only a table of real numbers can hold, if there is
            one.
    """

    def __init__(self, folder: Path):
        self.frames = 0
        self.shape: tuple[int, int] | None = None
        self.dtype = np.dtype(np.int16)
        self.dtypes = set[np.dtype]()
        self.low = np.full((0, 0), np.inf)
        self.high = np.full((0, 0), -np.inf)
        self.fault: Fault | None = None
        self.integer_fault: Fault | None = None
        self._folder = folder

    def append(self, pressure: Any, dtype: np.dtype) -> None:
        """Append the frames of a recording.

        Args:
            pressure: (T, H, W), an array or a dataset that is read in blocks.
            dtype: the type in which a table stores it, see `storage_type`.
        """
        if self.shape is None:
            self._begin(pressure.shape[1:], dtype)
        self.dtypes.add(dtype)
        self._widen(dtype)
        for start in range(0, len(pressure), BLOCK_FRAMES):
            block = np.asarray(pressure[start : start + BLOCK_FRAMES])
            self._check(block, dtype)
            np.minimum(self.low, block.min(axis=0), out=self.low)
            np.maximum(self.high, block.max(axis=0), out=self.high)
            with (self._folder / COUNTS).open("ab") as file:
                file.write(block.astype(self.dtype).tobytes())
            self.frames += len(block)

    def finish(self) -> None:
        """Write the number of frames into the file."""
        with (self._folder / COUNTS).open("rb+") as file:
            self._write_header(file, self.dtype)

    def sort(self, first: int, order: np.ndarray) -> None:
        """Sort n frames that begin at `first`.

        Args:
            first: the number of the first frame.
            order: (n,) the new order, as indices counted from `first`.
        """
        frames = self.read(first, len(order))
        with (self._folder / COUNTS).open("rb+") as file:
            file.seek(self._place_of(first))
            file.write(frames[order].tobytes())

    def read(self, first: int, frames: int) -> np.ndarray:
        """Return some of the written counts (frames, H, W).

        The counts are read and not memory-mapped, since a map of all counts would count against the
        limit on memory.

        Args:
            first: the number of the first frame.
            frames: the number of frames.
        """
        shape = (frames, *(self.shape or ()))
        with (self._folder / COUNTS).open("rb") as file:
            file.seek(self._place_of(first))
            return np.fromfile(file, self.dtype, prod(shape)).reshape(shape)

    def _begin(self, shape: tuple[int, int], dtype: np.dtype) -> None:
        self.shape = (int(shape[0]), int(shape[1]))
        self.dtype = dtype
        self.low = np.full(self.shape, np.inf)
        self.high = np.full(self.shape, -np.inf)
        self._folder.mkdir(exist_ok=True)
        with (self._folder / COUNTS).open("wb") as file:
            self._write_header(file, dtype)

    def _write_header(self, file: BinaryIO, dtype: np.dtype) -> None:
        """Write the header, whose length does not depend on the number of frames."""
        header = {
            "descr": np.lib.format.dtype_to_descr(dtype),
            "fortran_order": False,
            "shape": (self.frames, *(self.shape or ())),
        }
        np.lib.format.write_array_header_1_0(file, header)

    def _place_of(self, frame: int) -> int:
        """Return the byte of the file at which a frame begins."""
        bytes_of_frame = prod(self.shape or ()) * self.dtype.itemsize
        size = (self._folder / COUNTS).stat().st_size
        header = size - self.frames * bytes_of_frame
        return header + frame * bytes_of_frame

    def _widen(self, dtype: np.dtype) -> None:
        """Write the file again in a wider type, if its type cannot hold values of another type."""
        wider = np.promote_types(self.dtype, dtype)
        if wider == self.dtype:
            return
        wide = self._folder / f"wide-{COUNTS}"
        with wide.open("wb") as file:
            self._write_header(file, wider)
            for start in range(0, self.frames, BLOCK_FRAMES):
                block = self.read(start, min(BLOCK_FRAMES, self.frames - start))
                file.write(block.astype(wider).tobytes())
        wide.rename(self._folder / COUNTS)
        self.dtype = wider

    def _check(self, block: np.ndarray, dtype: np.dtype) -> None:
        """Keep the first reading of a block (n, H, W) that is out of range."""
        is_integer = dtype.kind == "i"
        if is_integer and np.can_cast(block.dtype, dtype):
            return
        low, high = limits("pressure", dtype)
        row = first_unfit(block, low, high, is_whole=is_integer)
        if row is None:
            return
        frame = block[row].ravel()
        if frame.dtype.kind == "f":
            frame = frame.astype(np.float64)  # float16 does not hold the limits
        inside = (frame >= low) & (frame <= high)
        value = float(frame[~inside][0])
        fault = Fault("pressure", self.frames + row, value, low, high, is_integer)
        if is_integer:
            self._widen(ENDLESS)
            self.integer_fault = self.integer_fault or fault
        else:
            self.fault = self.fault or fault
