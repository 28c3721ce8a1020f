"""Reading HDF5 and MATLAB: STAG's metadata.mat and raw recordings, recordings of other gloves, arrays in .mat files.

Files of MATLAB 7.3 are HDF5 with reversed axes; SciPy reads the older ones. STAG's fields follow the descriptions that
come with the data set of Sundaram et al., "Learning the signatures of the human grasp using a scalable tactile glove",
Nature 569, 698-702 (2019). All indices are zero-based, per-frame fields are column vectors (T, 1), names are cell
arrays (1, K).

Recordings of other gloves are in HDF5, one a file:

/pressure     (T, H, W)  integer counts or real numbers, up to 256 x 256
/time         (T,)       seconds, optional
/valid        (T,)       whether the object is held, optional
/grasp        (T,)       number of the grasp, optional
/grasp_valid  (T,)       whether the frame is in the steady part of its grasp, optional
attributes    object, session; optional: recording (else the file's path in the folder), split ("train" or "test")

A file may come from anybody: nothing in it leads to a different file.
"""

import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.messages import UserError, listed
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.join import check_values
from tactile_viewgcn.readers.source import NUMBERS, Form, Recording, Source, Values, no_array, side_of, sliced

NAMES = ("objects", "recordings", "batches", "splits")
#: Column of each per-frame field of metadata.mat
COLUMN_OF_FIELD = {
    "objectId": "object",
    "recordingId": "recording",
    "batchId": "session",
    "frame": "frame",
    "ts": "time",
    "splitId": "split",
    "hasValidLabel": "valid",
    "isBalanced": "balanced",
    "graspIndex": "grasp",
    "graspValid": "grasp_valid",
}
COLUMN_OF_RAW_FIELD = {"tStamp": "time", "frame": "frame"}
REQUIRED = ("pressure", *NAMES[:3], *list(COLUMN_OF_FIELD)[:3])
DATASETS = ("pressure", "time", "valid", "grasp", "grasp_valid")
ATTRIBUTES = ("object", "session", "recording", "split")
CACHE = 64 * 2**20  # bytes of a chunk that is kept for the next block


def is_raw(file: Path, folder: Path) -> bool:
    """Whether a file below a folder is a raw recording of STAG, `[batch]/[recording]/pressuredata.mat`."""
    return file.name == "pressuredata.mat" and len(file.relative_to(folder).parts) == 3


def read_raw(file: Path) -> Recording:
    """The raw recording in a file; its object is the folder's name without the number: "003-tea_box" holds tea_box."""
    session, name = file.parts[-3:-1]
    names = {"object": re.sub(r"^\d+-", "", name), "recording": f"{session}/{name}", "session": session}
    return Recording(names, _values(matlab_fields(file, ("pressure", *COLUMN_OF_RAW_FIELD)), COLUMN_OF_RAW_FIELD))


def read_metadata(path: Path) -> Source:
    """The source of a `metadata.mat`.

    Raises:
        UserError: not a MAT-file, or cut short; a field is missing, or has the wrong length or kind.
    """
    with reading(path):
        fields = matlab_fields(path, ("pressure", *COLUMN_OF_FIELD, *NAMES))
        if missing := [name for name in REQUIRED if name not in fields]:
            found = listed(list(fields)) or "nothing"
            raise UserError(f"{path}: no field {', '.join(missing)}; found {found}; if cut short, download it again")
        if wrong := [name for name, field in fields.items() if isinstance(field, list) != (name in NAMES)]:
            what = "a cell array of names" if wrong[0] in NAMES else "an array of numbers"
            raise UserError(f"{path}: {wrong[0]}: expected {what}")
        values = _values(fields, COLUMN_OF_FIELD)
        shape, dtype = check_values(values, str(path))
        if "split" in values:
            names = fields.get("splits", ["train", "test"])
            sides = np.array([-1 if (side := side_of(name)) is None else side for name in names])
            if not np.isin(values["split"], np.flatnonzero(sides >= 0)).all():
                raise UserError(f"{path}: splitId and splits {listed(names)}; expected numbers of train and test in it")
            values["split"] = sides[values["split"].astype(np.int64)]
    names = {"object": fields["objects"], "recording": fields["recordings"], "session": fields["batches"]}
    frames = len(values["pressure"])
    return Source(path, names, shape, dtype, frames, sliced(values, frames))


def _values(fields: dict[str, Any], columns: Mapping[str, str]) -> Values:
    """Pressure (T, H, W) and the columns (T,) that the fields of a file hold."""
    values = {column: np.ravel(fields[name]) for name, column in columns.items() if name in fields}
    return {"pressure": fields["pressure"]} | values


def matlab_fields(path: Path, names: Collection[str] = ()) -> dict[str, Any]:
    """Those of the named fields that a MAT-file has: numbers with MATLAB's axes; a cell array as a list of its texts.

    Without names all fields of numbers.

    Raises:
        UserError: a named field is neither, or its values lie outside the file.
    """
    if h5py.is_hdf5(path):
        with open_hdf5(path) as file:
            names = names or [name for name in file if _is_numbers(file.get(name))]
            return {name: _of_hdf5(file, name) for name in file if name in names}
    from scipy import io  # here, since it loads slowly

    fields = io.loadmat(path, variable_names=names or None)
    names = names or [
        name for name, field in fields.items() if isinstance(field, np.ndarray) and field.dtype.kind in NUMBERS
    ]
    return {name: _of_matlab5(fields[name], f"{path}: {name}") for name in names if name in fields}


def _is_numbers(field: Any) -> bool:
    """Whether a field of MATLAB 7.3 holds numbers, and not the codes of letters."""
    is_dataset = isinstance(field, h5py.Dataset) and field.shape is not None
    return is_dataset and kind_of(field.dtype) == "numbers" and field.attrs.get("MATLAB_class", b"") != b"char"


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
        return values[()].T
    texts = []
    for reference in values[()].ravel():
        codes = dataset(file, reference, "numbers")
        letters = "".join(map(chr, codes[()].ravel()))  # letters outside the first 65,536 are stored as two codes
        texts.append(letters.encode("utf-16", "surrogatepass").decode("utf-16"))
    return texts


def read_recording(file: h5py.File, form: Form) -> Recording:
    """The recording in a file; its datasets, which are read when they are sliced, keep it open.

    Frames that read NaN are dropped if `valid` says that nothing is held.

    Raises:
        UserError: there is no pressure, or the file lacks a name that the form gives.
    """
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
