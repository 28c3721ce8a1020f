"""Telling what form of recordings a path holds, and opening it."""

from pathlib import Path

import h5py

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.hdf5 import SUFFIXES, read_hdf5
from tactile_viewgcn.readers.source import SOURCE_MD5, Source, attribute_names
from tactile_viewgcn.readers.stag_folder import read_folder
from tactile_viewgcn.readers.stag_metadata import read_metadata

EXPECTED = "expected a STAG metadata.mat, a STAG folder, or HDF5 recordings (see the manual's page on data)"


def open_source(path: str | Path, *, labelled: bool = True) -> Source:
    """The source at a path: a STAG metadata.mat, a folder of STAG recordings, or the project's HDF5 recordings.

    Args:
        labelled: False: HDF5 recordings may lack `object` and `session`, see `read_hdf5`.

    Raises:
        FileNotFoundError: nothing at that path.
        UserError: none of these forms, or damaged.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder; {EXPECTED}")
    if path.is_dir():
        if next(path.glob("*/*/pressuredata.mat"), None):
            return read_folder(path)
        if any(file.suffix in SUFFIXES for file in path.rglob("*")):
            return read_hdf5(path, labelled=labelled)
        raise UserError(f"{path}: neither [batch]/[recording]/pressuredata.mat nor .h5 recordings in it; {EXPECTED}")
    if not path.stat().st_size:
        raise UserError(f"{path}: an empty file; {EXPECTED}")
    attributes = attribute_names(path)
    if SOURCE_MD5 in attributes:
        raise UserError(f"{path}: the table that ingest writes, not what it reads; {EXPECTED}")
    if path.suffix in SUFFIXES or "object" in attributes:  # which no MATLAB 7.3 file has
        return read_hdf5(path, labelled=labelled)
    if path.suffix == ".mat" or h5py.is_hdf5(path):
        return read_metadata(path)
    raise UserError(f"{path}: neither a MAT-file by its name (.mat) nor an HDF5 file; {EXPECTED}")
