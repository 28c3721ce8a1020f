"""Reading fields of MAT-files, of MATLAB 5 by SciPy and of MATLAB 7.3, which are HDF5 with reversed axes."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.source import open_hdf5

#: MATLAB's classes that are no arrays of numbers
NOT_NUMBERS = ("char", "cell", "struct", "object", "function", "opaque")


@contextmanager
def readable_mat(path: Path) -> Iterator[None]:
    """Turn every error of reading a MAT-file into a UserError: a damaged file fails in SciPy and zlib in many ways."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        raise UserError(
            f"{path}: not a readable MAT-file, or cut short ({type(error).__name__}: "
            f"{' '.join(str(error).split())}); expected MATLAB 5 or 7.3; download it again"
        ) from None


def mat_shapes(path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
    """Shape and type (also `struct` or `cell`) of each field, from the headers alone.

    A header of MATLAB 5 does not say in which type whole numbers of class double are stored.
    """
    from scipy import io

    with readable_mat(path):
        if not h5py.is_hdf5(path):
            return {name: (shape, kind) for name, shape, kind in io.whosmat(str(path))}
        with open_hdf5(path) as file:
            return {name: _shape_and_type(file[name]) for name in file if not name.startswith("#")}


def mat_fields(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Those of the named fields that there are: arrays; a cell array as a list of its texts."""
    from scipy import io

    with readable_mat(path):
        if h5py.is_hdf5(path):
            with open_hdf5(path) as file:
                return {name: _of_hdf5(file, file[name]) for name in names if name in file}
        fields = {name: values for name, values in io.loadmat(str(path), variable_names=names).items() if name in names}
        return {
            name: [str(np.squeeze(cell)) for cell in values.ravel()] if values.dtype == object else values
            for name, values in fields.items()
        }


def mat_frames(path: Path, name: str) -> tuple[np.dtype, Callable[[slice], np.ndarray]]:
    """Type of a field (T, ...), and a function that reads a slice of it: a file of MATLAB 5 has to be read whole."""
    with readable_mat(path):
        if h5py.is_hdf5(path):
            dataset = open_hdf5(path)[name]  # which keeps the file open
            axes = tuple(range(dataset.ndim))[::-1]
            return dataset.dtype, lambda at: dataset[..., at].transpose(axes)
    values = mat_fields(path, [name])[name]
    return values.dtype, lambda at: np.ascontiguousarray(values[at])


def _shape_and_type(item: h5py.Dataset | h5py.Group) -> tuple[tuple[int, ...], str]:
    if not isinstance(item, h5py.Dataset):
        return (), "struct"
    return item.shape[::-1], "cell" if h5py.check_ref_dtype(item.dtype) else str(item.dtype)


def _of_hdf5(file: h5py.File, dataset: h5py.Dataset) -> Any:
    """The array of a field, or the texts of a cell array, which holds references to arrays of character codes."""
    if h5py.check_ref_dtype(dataset.dtype):
        return ["".join(map(chr, file[reference][()].ravel())) for reference in dataset[()].ravel()]
    return dataset[()].T
