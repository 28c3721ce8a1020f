"""Read NumPy's files: the memory-mapped array of a .npy, and the named arrays of a .npz."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy_format

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.child import check_unpacked, library

READ_HEADER = {
    (1, 0): npy_format.read_array_header_1_0,
    (2, 0): npy_format.read_array_header_2_0,
}


def read_npy(file: Path) -> np.ndarray:
    """Return the memory-mapped array of a .npy file.

    The file is opened only once, unlike in NumPy's own functions.

    Raises:
        UserError: the file is damaged or cut short, holds Python objects, or goes on after its
            array.
    """
    with file.open("rb") as stream:
        with library(file):
            version = npy_format.read_magic(stream)
            shape, is_fortran, dtype = READ_HEADER[version](stream)
            begin = stream.tell()
        if dtype.hasobject:
            raise UserError(f"{file}: it holds Python objects; save it as an array of numbers")
        size = dtype.itemsize * int(np.prod(shape, dtype=object))
        if begin + size < file.stat().st_size:
            what = "more bytes follow after the array"
            raise UserError(f"{file}: {what}; save the array again in a file of its own")
        with library(file):
            if size == 0:
                return np.empty(shape, dtype=dtype)
            order: Any = "F" if is_fortran else "C"
            return np.memmap(stream, dtype, mode="r", offset=begin, shape=shape, order=order)


def read_npz(file: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a .npz file by their names.

    The sizes of all arrays are checked before any of them is unpacked.

    Raises:
        UserError: the file is damaged, or unpacks to more than is allowed for its size.
    """
    with file.open("rb") as stream:
        with library(file), zipfile.ZipFile(stream) as archive:
            size = sum(member.file_size for member in archive.infolist())
        check_unpacked(file, size)
        stream.seek(0)
        with library(file), np.load(stream, allow_pickle=False) as stored:
            return dict(stored)
