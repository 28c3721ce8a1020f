"""Telling what a path holds, and opening it."""

from pathlib import Path

import h5py

from tactile_viewgcn.own_format import read_own
from tactile_viewgcn.recordings import Source, is_table
from tactile_viewgcn.stag import read_folder, read_metadata

REMEDY = "set data.source to a STAG metadata.mat, a STAG folder, or recordings in the HDF5 form of the README"


def open_source(path: str | Path) -> Source:
    """A STAG metadata.mat, a folder of STAG recordings, or the project's own HDF5 recordings.

    Raises:
        FileNotFoundError: nothing at that path.
        ValueError: something else, or damaged; the sentence says what was found and what to do.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder; {REMEDY}")
    if path.is_dir():
        if next(path.glob("*/*/pressuredata.mat"), None):
            return read_folder(path)
        if any(p.suffix in (".h5", ".hdf5") for p in path.rglob("*")):
            return read_own(path)
        raise ValueError(f"{path}: neither [batch]/[recording]/pressuredata.mat nor .h5 recordings in it; {REMEDY}")
    if not path.stat().st_size:
        raise ValueError(f"{path}: an empty file; {REMEDY}")
    if is_table(path):
        raise ValueError(f"{path}: the table that ingest writes, not what it reads; {REMEDY}")
    if h5py.is_hdf5(path):
        return read_own(path) if path.suffix in (".h5", ".hdf5") or _names_object(path) else read_metadata(path)
    return read_metadata(path)


def _names_object(path: Path) -> bool:
    """Whether an HDF5 file is of our own form: MATLAB 7.3 marks its arrays, our own form its object."""
    try:
        with h5py.File(path, "r") as file:
            return "object" in file.attrs
    except OSError:  # cut short: read_metadata says so
        return False
