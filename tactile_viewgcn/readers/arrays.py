"""Reading arrays: .npy, .npz, MATLAB and HDF5, each as a mapping of arrays by their names; and STAG's files.

An array is (frames, rows, columns), or (frames, cells) with the cells row after row. With a shape (rows and
columns of a frame) it may also be one frame; without one, (frames, cells) are frames of one row.

HDF5 holds one recording:

/pressure     (T, H, W)  integer counts or real numbers, up to 256 x 256
/time         (T,)       seconds, optional
/valid        (T,)       whether the object is held, optional
/grasp        (T,)       number of the grasp, optional
/grasp_valid  (T,)       whether the frame is in the steady part of its grasp, optional
attributes    object, session; optional: recording (else the file's path in the folder), split ("train" or "test")

The fields of STAG's files follow the descriptions that come with the data set of Sundaram et al., "Learning the
signatures of the human grasp using a scalable tactile glove", Nature 569, 698-702 (2019). All indices are zero-based,
per-frame fields are column vectors (T, 1), names are cell arrays (1, K).
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.messages import Note, UserError, listed
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.join import check_values
from tactile_viewgcn.readers.source import NUMBERS, Form, Recording, Source, Values, setting, side_of, sliced

DATASETS = ("pressure", "time", "valid", "grasp", "grasp_valid")
ATTRIBUTES = ("object", "session", "recording", "split")
OVERLAP_CHANGES = 3  # fewest readings that change from a frame to the next, in the frames that two windows share
CACHE = 64 * 2**20  # bytes of a chunk that is kept for the next block
NAMES = ("objects", "recordings", "batches", "splits")
#: Column of each per-frame field
COLUMN_OF_FIELD = {
    "objectId": "object",
    "recordingId": "recording",
    "batchId": "session",
    "frame": "frame",
    "ts": "time",
    "tStamp": "time",  # of a raw recording
    "splitId": "split",
    "hasValidLabel": "valid",
    "isBalanced": "balanced",
    "graspIndex": "grasp",
    "graspValid": "grasp_valid",
}
REQUIRED = ("pressure", *NAMES[:3], *list(COLUMN_OF_FIELD)[:3])


def recordings_of_arrays(file: Path, form: Form) -> list[Recording]:
    """The recording in a file of arrays, or those of its windows with labels; see `recording_of`.

    Datasets of HDF5, which are read when they are sliced, keep their file open.
    """
    match file.suffix.lower():
        case ".npy":
            array = np.load(file, mmap_mode="r", allow_pickle=False)
            if array.offset + array.nbytes != file.stat().st_size:
                raise ValueError("there are more bytes after the array")
            arrays: Mapping[str, Any] = {form.names.get("pressure", "pressure"): array}
        case ".npz":
            with np.load(file, allow_pickle=False) as stored:
                arrays = dict(stored)
        case ".mat":
            arrays = matlab_fields(file)
        case _:
            arrays = open_hdf5(file)
    left = [name for name in form.left_out if name in arrays or name in getattr(arrays, "attrs", ())]
    return [replace(one, left_out=left) for one in windows_in(file, arrays, form) or [recording_of(file, arrays, form)]]


def recording_of(file: Path, arrays: Mapping[str, Any], form: Form) -> Recording:
    """The recording in arrays: `pressure` or the only array, and what the form names; all datasets of HDF5.

    Frames that read NaN are dropped if `valid` says that nothing is held. A UserError names what the file lacks.
    """
    is_hdf5, attributes = isinstance(arrays, h5py.File), getattr(arrays, "attrs", {})
    kinds = {*(DATASETS if is_hdf5 else DATASETS[:1]), *ATTRIBUTES}.difference(form.left_out)
    in_file = {kind: kind for kind in kinds} | form.names
    large = [] if is_hdf5 else [name for name in arrays if sum(size > 1 for size in np.shape(arrays[name])) > 1]
    if "pressure" not in form.names and len(large := [name for name in large if name not in form.left_out]) == 1:
        in_file["pressure"] = large[0]
    names = {kind: _text(attributes[in_file[kind]]) for kind in ATTRIBUTES if in_file.get(kind, " ") in attributes}
    values = {kind: each for kind in DATASETS if (each := arrays.get(in_file.get(kind, ""))) is not None}
    for kind in ("pressure", *form.names):
        if kind not in {*values, *names} and (form.labelled or kind not in ATTRIBUTES):
            remedy = f"if one has the readings, {setting('data.columns=[pressure:NAME]')}"
            raise UserError(f"{file}: no array {in_file[kind]}; found {listed([*arrays]) or 'none'}; {remedy}")
    values |= {kind: np.ravel(each) for kind, each in values.items() if kind != "pressure" and not is_hdf5}
    counts, dropped = values["pressure"], 0
    if "valid" in values and counts.dtype.kind == "f" and values["valid"].shape == counts.shape[:1]:
        unread = np.isnan(counts[()]).any(axis=tuple(range(1, counts.ndim)))
        kept = np.flatnonzero((values["valid"][()] != 0) | ~unread)
        if dropped := len(counts) - len(kept):
            values = {name: each[()][kept] for name, each in values.items()} | {"frame": kept}
    return Recording(names, values, dropped=dropped)


def windows_in(file: Path, arrays: Mapping[str, Any], form: Form) -> list[Recording]:
    """The windows X (n, T, C) or (n, T, H, W) among arrays with labels y (n,), a recording each; none without labels.

    A window that overlaps the one before is of the same take, see `overlapping`.
    """
    name = form.names.get("object") or next((each for each in arrays if each.lower() in ("y", "label", "labels")), "")
    if "pressure" in arrays or name not in arrays:
        return []
    labels = [one.decode() if isinstance(one, bytes) else one for one in np.ravel(arrays[name]).tolist()]
    large = [key for key in arrays if getattr(arrays.get(key), "ndim", 0) > 2 and len(arrays[key]) == len(labels) > 0]
    if len(large) != 1 or [*arrays[large[0]].shape[1:]] == [*form.shape]:
        return []
    X = arrays[large[0]][()]
    note = Note(f"{large[0]} holds {len(X):,} windows of {X.shape[1]} frames, labelled by {name}", topic="windows")
    recordings = list[Recording]()
    for at, (window, label, take) in enumerate(zip(X, labels, np.cumsum([0, *~overlapping(X)]).tolist(), strict=True)):
        label = f"{label:.0f}" if isinstance(label, float) else f"{label}"
        names = {"recording": f"{file.stem}/{at}", "object": label, "take": f"{file}/{take}"}
        recordings.append(Recording(names, {"pressure": window}, notes=[note]))
    return recordings


def overlapping(X: np.ndarray) -> np.ndarray:
    """Whether each window (n, T, ...) but the first overlaps the one before: bool (n - 1,).

    The last frames of the one before are its first frames, two at least, and three readings change in them. Frames at
    rest and padding are alike in all windows: equal frames that do not change are no overlap.
    """
    from pandas import DataFrame  # here, since it loads slowly
    from pandas.util import hash_pandas_object

    count, length = X.shape[:2]
    frames = X.reshape(count, length, -1)
    numbers = hash_pandas_object(DataFrame(frames.reshape(count * length, -1)), index=False)  # equal of equal frames
    numbers = numbers.to_numpy().reshape(count, length)
    before, after = numbers[:-1], numbers[1:]
    changed = np.count_nonzero(frames[1:, 1:] != frames[1:, :-1], axis=2)
    changes = np.cumsum(changed, axis=1)  # up to the second frame, the third and so on
    least = max(1, min(OVERLAP_CHANGES, (length - 2) * frames.shape[2]))  # of short windows all but one frame's
    is_first = before == after[:, :1]  # frames of the one before that are the first of the next
    is_last = after == before[:, -1:]  # frames of the next that are the last of the one before
    overlaps = np.zeros(len(after), dtype=bool)
    for shared in range(2, length + 1):
        may_overlap = is_first[:, length - shared] & is_last[:, shared - 1] & (changes[:, shared - 2] >= least)
        rows = np.flatnonzero(may_overlap & ~overlaps)
        overlaps[rows] = (before[rows, length - shared :] == after[rows, :shared]).all(axis=1)
    return overlaps


def matlab_fields(path: Path) -> dict[str, Any]:
    """The fields of a MAT-file that are numbers, with MATLAB's axes, or cell arrays of texts, as lists.

    Files of MATLAB 7.3 are HDF5 with reversed axes; SciPy reads the older ones.
    """
    if h5py.is_hdf5(path):
        with open_hdf5(path) as file:
            fields = {name: _of_matlab73(file, file.get(name)) for name in file}
    else:
        from scipy import io  # here, since it loads slowly

        fields = {name: _of_matlab5(value) for name, value in io.loadmat(path).items()}
    return {name: value for name, value in fields.items() if value is not None}


def _of_matlab5(value: Any) -> Any:
    """Numbers, or the texts of a cell array; None of any other value."""
    kind = value.dtype.kind if isinstance(value, np.ndarray) else ""
    cells = [np.asarray(cell) for cell in value.ravel(order="F")] if kind == "O" else []
    if kind == "O" and all(cell.dtype.kind == "U" for cell in cells):
        return [str(cell.ravel()[0]) if cell.size else "" for cell in cells]
    return value if kind and kind in NUMBERS else None


def _of_matlab73(file: h5py.File, values: Any) -> Any:
    """Numbers, or the texts of a cell array, which holds references to arrays of character codes; else None."""
    if getattr(values, "shape", None) is None or values.attrs.get("MATLAB_class") == b"char":
        return None
    if values.dtype.kind in NUMBERS:
        return values[()].T
    is_cells = h5py.check_ref_dtype(values.dtype) is h5py.Reference
    cells: list[Any] = [file[reference] for reference in values[()].ravel()] if is_cells else [None]
    if any(getattr(cell, "dtype", None) != np.uint16 for cell in cells):
        return None
    if any(_outside("a cell", cell) for cell in cells):  # where no name leads to it, `open_hdf5` does not visit it
        raise UserError(f"{file.filename}: a cell of {values.name} leads out of the file; expected it in the file")
    return [cell[()].ravel().astype("<u2").tobytes().decode("utf-16-le") for cell in cells]


def open_hdf5(path: Path) -> h5py.File:
    """An HDF5 file, which may come from anybody; a UserError if a link leads out of it, or values lie elsewhere."""
    file = h5py.File(path, "r", rdcc_nbytes=CACHE)
    if name := file.visititems_links(_outside) or file.visititems(_outside):
        raise UserError(f"{path}: /{name} leads out of the file; expected it in the file")
    return file


def _outside(name: str, each: Any) -> str | None:
    """The name of a link or a dataset that leads out of its file; else None."""
    leads_out = isinstance(each, h5py.ExternalLink) or getattr(each, "is_virtual", False)
    return name if leads_out or getattr(each, "external", None) else None


def _text(value: Any) -> str:
    """An attribute, one text or number, as text."""
    value = np.asarray(value).item()
    return value.decode() if isinstance(value, bytes) else str(value)


def read_raw(file: Path) -> Recording:
    """The raw recording of STAG in a file; its object is the folder's name without number: "003-tea_box" is tea_box."""
    session, name = file.parts[-3:-1]
    names = {"object": re.sub(r"^\d+-", "", name), "recording": f"{session}/{name}", "session": session}
    return Recording(names, _values(matlab_fields(file)))


def read_metadata(path: Path) -> Source:
    """The source of a `metadata.mat`; a UserError if a field is missing, or of the wrong length or kind."""
    with reading(path):
        fields = {name: each for name, each in matlab_fields(path).items() if isinstance(each, list) == (name in NAMES)}
        if missing := [name for name in REQUIRED if name not in fields]:
            what = f"no field {', '.join(missing)}; found {listed(list(fields)) or 'nothing'}"
            raise UserError(f"{path}: {what}; if cut short, download it again")
        values = _values(fields)
        shape, dtype = check_values(values, str(path))
        if "split" in values:
            sides = dict(enumerate(map(side_of, names := fields.get("splits", ["train", "test"]))))
            values["split"] = np.array([sides.get(number) for number in values["split"].tolist()])
            if None in values["split"]:
                raise UserError(f"{path}: splitId and splits {listed(names)}; expected numbers of train and test in it")
    names = {"object": fields["objects"], "recording": fields["recordings"], "session": fields["batches"]}
    return Source(path, names, shape, dtype, len(values["pressure"]), sliced(values, len(values["pressure"])))


def _values(fields: dict[str, Any]) -> Values:
    """Pressure (T, H, W) and the columns (T,) that the fields of a file hold."""
    values = {column: np.ravel(fields[name]) for name, column in COLUMN_OF_FIELD.items() if name in fields}
    return {"pressure": fields["pressure"]} | values
