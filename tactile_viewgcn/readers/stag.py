"""Reading STAG's recordings: metadata.mat, or folders of raw recordings.

They are files of MATLAB 5, or of MATLAB 7.3, which are HDF5 with reversed axes. The fields follow the descriptions that
come with the data set of Sundaram et al., "Learning the signatures of the human grasp using a scalable tactile glove",
Nature 569, 698-702 (2019). All indices are zero-based, per-frame fields are column vectors (T, 1), names are cell
arrays (1, K).
"""

import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.messages import UserError, listed
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.hdf5 import dataset, kind_of, open_hdf5
from tactile_viewgcn.readers.join import check_values
from tactile_viewgcn.readers.source import NUMBERS, SPLITS, Recording, Source, Values, sliced

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
            sides = np.array([SPLITS.get(name.lower(), -1) for name in names])
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
