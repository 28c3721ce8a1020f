"""Finding out in which form a path holds recordings, and opening them."""

from pathlib import Path

import h5py

from tactile_viewgcn.files import HDF5, all_below, arrays_below, files_below, stag_files
from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.readers.arrays import read_arrays
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.folder import MANY
from tactile_viewgcn.readers.hdf5 import open_hdf5, read_hdf5
from tactile_viewgcn.readers.places import PLACES
from tactile_viewgcn.readers.source import AUTO, SOURCE_MD5, Form, Source, listed
from tactile_viewgcn.readers.stag import matlab_fields, read_folder, read_metadata

EXPECTED = (
    f"expected a STAG metadata.mat, a STAG folder, HDF5 recordings, a folder of {PLACES}.npy, .npz, .mat, .csv or "
    ".txt, or a .csv with a column `object` (see the manual's page on data)"
)


def open_source(path: str | Path, form: Form = AUTO) -> Source:
    """The source at a path: STAG's metadata.mat or folder, HDF5 recordings, or arrays.

    A damaged file may crash this process; `read_source` uses a separate one.

    Args:
        form: of arrays, tables and HDF5 recordings.

    Raises:
        FileNotFoundError: nothing is at that path.
        UserError: a file is of none of these forms, or damaged.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder; {EXPECTED}")
    if stag_files(path):
        return read_folder(path)
    if path.is_file() and path.suffix.lower() == ".mat":
        with reading(path):
            is_stag = path.name == "metadata.mat" or matlab_fields(path, ("objectId",))
        return read_metadata(path) if is_stag else read_arrays(path, form)
    arrays, recordings = arrays_below(path), files_below(path, HDF5)
    few, many = sorted((arrays, recordings), key=len)
    if few and len(few) * MANY > len(many):
        raise UserError(f"{path}: HDF5 recordings ({recordings[0]}) and arrays ({arrays[0]}); keep one form elsewhere")
    if many:
        source = (read_arrays if many is arrays else read_hdf5)(path, form)
        if few:
            text = f"{several(len(few), 'file')} of a different form left out beside {len(many):,}: "
            source.notes.append(Note(text + listed(list(map(str, few))), "warning", "files"))
        return source
    is_hdf5, attributes = False, set()
    if not path.is_dir():
        with reading(path):
            if is_hdf5 := h5py.is_hdf5(path):
                attributes = set(open_hdf5(path).attrs)
    if {"object", SOURCE_MD5} & attributes:  # files of MATLAB 7.3 have neither
        return read_hdf5(path, form)
    if is_hdf5:
        return read_metadata(path)
    endings = sorted({file.suffix for file in (all_below(path) if path.is_dir() else [path])})
    raise UserError(f"{path}: no recordings in it, only files of {listed(endings)}; {EXPECTED}")
