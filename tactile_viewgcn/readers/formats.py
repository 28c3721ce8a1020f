"""Choose the function that reads a file, by the ending of its name."""

from collections.abc import Iterable
from pathlib import Path

from tactile_viewgcn.readers.arrays import recordings_of_arrays
from tactile_viewgcn.readers.hdf5 import Hdf5File
from tactile_viewgcn.readers.matlab import fields_of_hdf5, read_matlab
from tactile_viewgcn.readers.npy import read_npy, read_npz
from tactile_viewgcn.readers.source import Form, Recording
from tactile_viewgcn.readers.stag import is_stag, read_raw, recordings_of_metadata

TEXTS = (".csv", ".tsv", ".csv.gz", ".txt")  # endings of tables as text
HDF5 = (".h5", ".hdf5")
ARRAYS = (".npy", ".npz", ".mat")
STAG_METADATA = "metadata.mat"
STAG_RAW = "pressuredata.mat"  # in [batch]/[recording]/


def has_ending(file: Path, endings: Iterable[str]) -> bool:
    """Return whether a file has one of these endings, in capital or small letters."""
    return file.name.lower().endswith(tuple(endings))


def read_file(file: Path, form: Form) -> list[Recording]:
    """Return the recordings in a file that is no text, with the names that stand in it.

    Texts are read by `text.read_text` and `text.table_in`, since a text can also be a table of
    names. A file with any other ending is read as HDF5. Its datasets keep the file open until they
    are sliced.

    Raises:
        UserError: the file is damaged, unpacks to more than is allowed for its size, or lacks a
            name that the form gives.
    """
    if has_ending(file, [".npy"]):
        return recordings_of_arrays(
            file, {form.names.get("pressure", "pressure"): read_npy(file)}, form
        )
    if has_ending(file, [".npz"]):
        return recordings_of_arrays(file, read_npz(file), form)
    if file.name == STAG_RAW:
        return read_raw(file)
    if has_ending(file, [".mat"]):
        fields = read_matlab(file)
        if file.name == STAG_METADATA or is_stag(fields):
            return recordings_of_metadata(file, fields)
        return recordings_of_arrays(file, fields, form)
    datasets = Hdf5File(file)
    if is_stag(datasets):
        return recordings_of_metadata(file, fields_of_hdf5(datasets))
    return recordings_of_arrays(file, datasets, form)
