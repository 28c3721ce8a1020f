"""Read MATLAB's files: numbers and cell arrays of texts, by the names of their fields.

Files of MATLAB 7.3 are HDF5 with reversed axes. SciPy reads older files.
"""

import zlib
from math import prod
from os import SEEK_CUR
from pathlib import Path
from struct import unpack
from typing import Any, BinaryIO

import h5py
import numpy as np

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.child import check_unpacked, library
from tactile_viewgcn.readers.hdf5 import Hdf5File, is_hdf5, leads_out
from tactile_viewgcn.readers.source import NUMBERS

MATLAB5_HEADER = 128  # bytes
MATLAB5_TAG = 8  # bytes
MATLAB5_COMPRESSED = 15  # the kind of a compressed element
BEGINNING = 2048  # compressed bytes that are enough to unpack the first eight bytes


def read_matlab(file: Path) -> dict[str, Any]:
    """Return the fields of a MAT-file: numbers with MATLAB's axes, cell arrays as lists of texts.

    Raises:
        UserError: the file is damaged, unpacks to more than is allowed for its size, or leads to
            other files.
    """
    if is_hdf5(file):
        return fields_of_hdf5(Hdf5File(file))
    from scipy import io  # here, since it loads slowly

    with file.open("rb") as stream:
        check_unpacked(file, _declared_bytes(file, stream))
        stream.seek(0)
        with library(file):
            loaded = io.loadmat(stream)
    fields = {name: _of_matlab5(value) for name, value in loaded.items()}
    return {name: value for name, value in fields.items() if value is not None}


def fields_of_hdf5(file: Hdf5File) -> dict[str, Any]:
    """Return the fields of a MAT-file of MATLAB 7.3, as `read_matlab` does."""
    declared = 0
    for name in file:
        declared += prod(file[name].shape) * file[name].dtype.itemsize
    check_unpacked(file.path, declared)
    fields = {name: _of_matlab73(file, name) for name in file}
    return {name: value for name, value in fields.items() if value is not None}


def _declared_bytes(file: Path, stream: BinaryIO) -> int:
    """Return the bytes of all elements of a MAT-file of version 5; 0 for any other file.

    A compressed element counts with the bytes that it declares inside. The format is in MathWorks'
    "MAT-File Format": after a header, each element has a tag with its kind and its length, and then
    its bytes.
    """
    size = 0
    order = {b"IM": "<", b"MI": ">"}.get(stream.read(MATLAB5_HEADER)[-2:])
    tag = stream.read(MATLAB5_TAG)
    while order and len(tag) == MATLAB5_TAG:
        kind, length = unpack(f"{order}II", tag)
        inside = b""
        if kind == MATLAB5_COMPRESSED:
            beginning = stream.read(min(length, BEGINNING))
            length -= len(beginning)
            with library(file):
                inside = zlib.decompressobj().decompress(beginning, MATLAB5_TAG)
        if len(inside) == MATLAB5_TAG:
            size += unpack(f"{order}II", inside)[1]
        stream.seek(length, SEEK_CUR)
        size += length
        tag = stream.read(MATLAB5_TAG)
    return size


def _of_matlab5(value: Any) -> Any:
    """Return numbers, or the texts of a cell array; None for any other value."""
    if not isinstance(value, np.ndarray):
        return None
    if value.dtype.kind in NUMBERS:
        return value
    if value.dtype.kind != "O":
        return None
    cells = [np.asarray(cell) for cell in value.ravel(order="F")]
    if any(cell.dtype.kind != "U" for cell in cells):
        return None
    return [str(cell.ravel()[0]) if cell.size else "" for cell in cells]


def _of_matlab73(file: Hdf5File, name: str) -> Any:
    """Return numbers, or the texts of a cell array; None for any other value.

    A cell array holds references to arrays of character codes.
    """
    values = file[name]
    with library(file.path):
        dataset = file.file[name]
        is_text = dataset.attrs.get("MATLAB_class") == b"char"
        is_cells = h5py.check_ref_dtype(dataset.dtype) is h5py.Reference
    if is_text:
        return None
    if values.dtype.kind in NUMBERS:
        return values[()].T
    if not is_cells:
        return None
    with library(file.path):
        cells = [file.file[reference] for reference in np.ravel(values[()])]
        are_texts = all(getattr(cell, "dtype", None) == np.uint16 for cell in cells)
    if not are_texts:
        return None
    # `Hdf5File` does not check a cell that no name leads to
    if any(leads_out(file.path, cell) for cell in cells):
        raise UserError(
            f"{file.path}: a cell of {name} leads out of the file; expected it in the file"
        )
    check_unpacked(file.path, sum(prod(cell.shape or ()) for cell in cells) * 2)
    with library(file.path):
        return [cell[()].ravel().astype("<u2").tobytes().decode("utf-16-le") for cell in cells]
