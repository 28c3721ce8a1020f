"""Reading HDF5: recordings in the project's own form for gloves other than STAG, one a file, and what MATLAB 7.3 has.

/pressure     (T, H, W)  integer counts or real numbers, up to 256 x 256
/time         (T,)       seconds, optional
/valid        (T,)       whether the object is held, optional
/grasp        (T,)       number of the grasp, optional
/grasp_valid  (T,)       whether the frame is in the steady part of its grasp, optional
attributes    object, session; optional: recording (else the file's path in the folder), split ("train" or "test")

A file may come from anybody: nothing in it leads to a different file.
"""

from pathlib import Path

import h5py
import numpy as np

from tactile_viewgcn.messages import UserError, listed
from tactile_viewgcn.readers.source import NUMBERS, Form, Recording, no_array

DATASETS = ("pressure", "time", "valid", "grasp", "grasp_valid")
ATTRIBUTES = ("object", "session", "recording", "split")
CACHE = 64 * 2**20  # bytes of a chunk that is kept for the next block


def read_recording(path: Path, form: Form) -> Recording:
    """The recording in a file; its datasets, which are read when they are sliced, keep it open.

    Frames that read NaN are dropped if `valid` says that nothing is held.

    Raises:
        UserError: there is no pressure, or the file lacks a name that the form gives.
    """
    file = open_hdf5(path)
    in_file = {name: form.columns.get(name, name) for name in (*DATASETS, *ATTRIBUTES)}
    values = {name: dataset(file, in_file[name], "numbers") for name in DATASETS if file.get(in_file[name]) is not None}
    if "pressure" not in values:
        raise no_array(in_file["pressure"], list(file), file.filename)
    names = {name: _attribute(file, in_file[name]) for name in ATTRIBUTES if in_file[name] in file.attrs}
    if missing := form.columns.keys() - values.keys() - names.keys():
        raise UserError(f"{file.filename}: no {form.columns[missing.pop()]}; found {listed([*file, *file.attrs])}")
    frames = values["pressure"].shape[:1]
    if "valid" in values and values["pressure"].dtype.kind == "f" and values["valid"].shape == frames:
        unread = np.isnan(values["pressure"][()])
        reads = ~unread.any(axis=tuple(range(1, unread.ndim)))
        kept = np.flatnonzero((values["valid"][()] != 0) | reads)
        if dropped := frames[0] - len(kept):
            values = {name: each[()][kept] for name, each in values.items()} | {"frame": kept}
            return Recording(names, values, dropped=dropped)
    return Recording(names, values)


def open_hdf5(path: Path) -> h5py.File:
    """An HDF5 file, open for reading.

    Raises:
        UserError: a link leads out of the file.
    """
    file = h5py.File(path, "r", rdcc_nbytes=CACHE)
    if name := file.visititems_links(lambda name, link: name if isinstance(link, h5py.ExternalLink) else None):
        raise UserError(f"{path}: /{name} leads out of the file; expected it in the file")
    return file


def _attribute(file: h5py.File, name: str) -> str:
    """An attribute of the root, one text or number, as text."""
    value = np.asarray(file.attrs[name]).item()
    return value.decode() if isinstance(value, bytes) else str(value)


def dataset(file: h5py.File, name: str | h5py.Reference, *kinds: str) -> h5py.Dataset:
    """A dataset by its name, or by a reference.

    Raises:
        UserError: it is a group; or its values lie outside the file, or are of none of the `kinds` of `kind_of`.
    """
    values, where = file[name], f"{file.filename}: {f'/{name}' if isinstance(name, str) else 'a cell'}"
    if not isinstance(values, h5py.Dataset):
        raise UserError(f"{where} is a group; expected a dataset")
    if values.is_virtual or values.external:
        raise UserError(f"{where} has its values outside the file; expected them in it")
    if values.shape is None or kind_of(values.dtype) not in kinds:
        raise UserError(f"{where} is of type {values.dtype if values.shape else None}; expected {' or '.join(kinds)}")
    return values


def kind_of(dtype: np.dtype) -> str:
    """`numbers`, `references`, or the name of any other type."""
    is_reference = h5py.check_ref_dtype(dtype) is h5py.Reference
    return "references" if is_reference else "numbers" if dtype.kind in NUMBERS else str(dtype)
