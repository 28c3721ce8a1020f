"""Reading fields of MAT-files of MATLAB 5, and of MATLAB 7.3, which are HDF5 with reversed axes."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import check_is_file, readable_source
from tactile_viewgcn.readers.hdf5_file import (
    DATASET,
    GROUP,
    NOWHERE,
    NUMBERS,
    OBJECTS,
    OUTWARD,
    check_dataset,
    dataset,
    kind_of,
    open_hdf5,
)
from tactile_viewgcn.readers.source import MOST_LETTERS, MOST_NAMES

#: MATLAB's classes that are no arrays of numbers
NOT_NUMBERS = (
    *("char", "cell", "struct", "object", "function", "opaque", "sparse", "complex", "unknown"),
    *(GROUP, OUTWARD, NOWHERE),
)
DAMAGED = "not a readable MAT-file, or cut short"
REMEDY = "expected MATLAB 5 or 7.3; download it again"


def mat_shapes(path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
    """Shape and type (also `group` or `cell`) of each field, from the headers alone.

    A header of MATLAB 5 does not say in which type whole numbers of class double are stored.

    Raises:
        UserError: it is damaged.
    """
    check_is_file(path)
    with readable_source(path, DAMAGED, REMEDY):
        if not h5py.is_hdf5(path):
            from scipy import io  # here: it loads slowly

            variables = io.whosmat(path)
            if len(shapes := {name: (shape, kind) for name, shape, kind in variables}) < len(variables):
                raise ValueError("a field stands twice")
            return shapes
        with open_hdf5(path) as file:
            return {name: _shape_and_type(file, name) for name in file if not name.startswith("#")}


def mat_fields(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Those of the named fields that there are, which `mat_shapes` knows: arrays; a cell array as a list of its texts.

    Raises:
        UserError: as `mat_shapes`, or a field does not hold what it declares.
    """
    with readable_source(path, DAMAGED, REMEDY):
        if not h5py.is_hdf5(path):
            from scipy import io

            fields = io.loadmat(path, variable_names=names)
            return {name: _of_matlab5(fields[name]) for name in names if name in fields}
        with open_hdf5(path) as file:
            return {name: _of_hdf5(file, name) for name in file if name in names}


def mat_frames(path: Path, name: str) -> tuple[np.dtype, Callable[[slice], np.ndarray]]:
    """Type of a field (T, ...), and a function that reads a slice of it: a file of MATLAB 5 has to be read whole."""
    with readable_source(path, DAMAGED, REMEDY):
        if h5py.is_hdf5(path):
            values = dataset(open_hdf5(path), name)  # which keeps the file open
            axes = tuple(range(values.ndim))[::-1]

            def read(at: slice) -> np.ndarray:
                with readable_source(path, DAMAGED, REMEDY):
                    return values[..., at].transpose(axes)

            return values.dtype, read
    whole = mat_fields(path, [name])[name]
    return whole.dtype, lambda at: np.ascontiguousarray(whole[at])


def _of_matlab5(value: np.ndarray) -> Any:
    """The array of a field, or the texts of a cell array."""
    if value.dtype.kind != OBJECTS:
        return value.astype(value.dtype.newbyteorder("="), copy=False)
    if others := [cell.dtype for cell in value.ravel() if cell.dtype.kind != "U"]:
        raise ValueError(f"a cell is of type {others[0]}, and no text")
    return [str(cell.ravel()[0]) if cell.size else "" for cell in value.ravel(order="F")]


def _shape_and_type(file: h5py.File, name: str) -> tuple[tuple[int, ...], str]:
    if (kind := kind_of(file, name)) != DATASET:
        return (), kind
    values = file[name]
    return (values.shape or ())[::-1], "cell" if h5py.check_ref_dtype(values.dtype) else str(values.dtype)


def _of_hdf5(file: h5py.File, name: str) -> Any:
    """The array of a field, or the texts of a cell array, which holds references to arrays of character codes."""
    values = dataset(file, name, NUMBERS + OBJECTS)
    if values.dtype.kind != OBJECTS:
        return values[()].T
    where, texts = f"{file.filename}: a cell of /{name}", []
    if values.size > MOST_NAMES:
        raise UserError(f"{file.filename}: /{name} has {values.size:,} cells; expected at most {MOST_NAMES:,} names")
    for reference in values[()].ravel():
        if not isinstance(codes := file[reference], h5py.Dataset):
            raise UserError(f"{where} is a group; expected a text")
        check_dataset(codes, where)
        if codes.size > MOST_LETTERS:
            raise UserError(f"{where} has {codes.size:,} letters; expected a name of at most {MOST_LETTERS:,}")
        letters = "".join(map(chr, codes[()].ravel()))  # those outside the first 65,536 are stored as two
        texts.append(letters.encode("utf-16", "surrogatepass").decode("utf-16"))
    return texts
