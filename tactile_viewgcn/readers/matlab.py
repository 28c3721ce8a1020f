"""Reading fields of MAT-files of MATLAB 5, and of MATLAB 7.3, which are HDF5 with reversed axes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.hdf5_file import check_dataset, dataset, kind_of, open_hdf5
from tactile_viewgcn.readers.source import NUMBERS


class Reversed:
    """A dataset of MATLAB 7.3 with MATLAB's axes, read when it is sliced by the first."""

    def __init__(self, values: h5py.Dataset):
        self._values, self.dtype, self.shape = values, values.dtype, values.shape[::-1]

    def __getitem__(self, at: slice) -> np.ndarray:
        return self._values[..., at].T


def mat_fields(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Those of the named fields that there are: numbers, all axes MATLAB's; a cell array as a list of its texts.

    A file of MATLAB 5 is read whole, numbers of MATLAB 7.3 when they are sliced.

    Raises:
        UserError: a field is neither, or its values lie outside the file.
    """
    if h5py.is_hdf5(path):
        file = open_hdf5(path)  # the fields keep it open
        return {name: _of_hdf5(file, name) for name in file if name in names}
    from scipy import io  # here: it loads slowly

    fields = io.loadmat(path, variable_names=names)
    return {name: _of_matlab5(fields[name], f"{path}: {name}") for name in names if name in fields}


def _of_matlab5(value: Any, where: str) -> Any:
    value = np.asarray(value)
    if value.dtype.kind in NUMBERS:
        return value
    if value.dtype.kind == "O" and all(getattr(cell, "dtype", value.dtype).kind == "U" for cell in value.flat):
        return [str(cell.ravel()[0]) if cell.size else "" for cell in value.ravel(order="F")]
    raise UserError(f"{where} is of type {value.dtype}; expected numbers, or a cell array of texts")


def _of_hdf5(file: h5py.File, name: str) -> Any:
    """Numbers, or the texts of a cell array, which holds references to arrays of character codes."""
    values = dataset(file, name, "numbers", "references")
    if kind_of(values.dtype) == "numbers":
        return Reversed(values)
    texts = []
    for reference in values[()].ravel():
        codes = file[reference]
        check_dataset(codes, f"{file.filename}: a cell of /{name}", "numbers")
        letters = "".join(map(chr, codes[()].ravel()))  # those outside the first 65,536 are stored as two
        texts.append(letters.encode("utf-16", "surrogatepass").decode("utf-16"))
    return texts
