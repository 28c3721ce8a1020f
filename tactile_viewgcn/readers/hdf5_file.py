"""Opening HDF5 files of recordings, which may come from anybody: nothing in them leads to another file."""

from pathlib import Path

import h5py
import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.source import NUMBERS

CACHE = 64 * 2**20  # bytes of a chunk that is kept for the next block


def open_hdf5(path: Path) -> h5py.File:
    """An HDF5 file, open for reading."""
    return h5py.File(path, "r", rdcc_nbytes=CACHE)


def attribute(file: h5py.File, name: str) -> str:
    """An attribute of the root as text; a UserError where it is no single text or number."""
    value = file.attrs[name]
    value = value.ravel()[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    if not isinstance(value, str | bytes | np.number | np.bool_):
        raise UserError(f"{file.filename}: attribute {name} is no single text; expected one, as for a recording")
    return value.decode() if isinstance(value, bytes) else str(value)


def dataset(file: h5py.File, name: str, *kinds: str) -> h5py.Dataset:
    """A dataset in the root, or at the end of a link within the file, with values as in `check_dataset`.

    Raises:
        KeyError: there is none.
        UserError: it is another object, or lies outside the file, or `check_dataset` refuses it.
    """
    if (link := file.get(name, getlink=True)) is None:
        raise KeyError(f"no /{name}")
    place = file
    for part in filter(None, link.path.split("/") if isinstance(link, h5py.SoftLink) else [name]):
        if not isinstance(place, h5py.Group) or not isinstance(place.get(part, getlink=True), h5py.HardLink):
            raise UserError(
                f"{file.filename}: /{name} is a link to another file or to nowhere; expected it in the file"
            )
        place = place[part]
    check_dataset(place, f"{file.filename}: /{name}", *kinds)
    return place


def check_dataset(values: h5py.Dataset | h5py.Group, where: str, *kinds: str) -> None:
    """Raise a UserError for a group, values outside the file, or of none of the kinds; it begins with `where`."""
    if not isinstance(values, h5py.Dataset):
        raise UserError(f"{where} is a group; expected a dataset")
    if values.is_virtual or values.external:
        raise UserError(f"{where} has its values outside the file; expected them in it")
    if values.shape is None or kind_of(values.dtype) not in kinds:
        raise UserError(f"{where} is of type {values.dtype if values.shape else None}; expected {' or '.join(kinds)}")


def kind_of(dtype: np.dtype) -> str:
    """`numbers`, `texts` or `references`, else the type's own name."""
    if h5py.check_string_dtype(dtype):
        return "texts"
    is_reference = h5py.check_ref_dtype(dtype) is h5py.Reference
    return "references" if is_reference else "numbers" if dtype.kind in NUMBERS else str(dtype)
