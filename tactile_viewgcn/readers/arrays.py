"""Make recordings of arrays with names: one recording, windows, or labelled frames.

An array is (frames, rows, columns), or (frames, cells) with the cells row after row. If the form
gives a shape (the rows and columns of a frame), an array can also be one frame. Without a shape,
(frames, cells) are frames of one row.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from tactile_viewgcn.messages import Note, UserError, listed, several
from tactile_viewgcn.readers.hdf5 import Hdf5File
from tactile_viewgcn.readers.lines import LABELS, label_kind, recordings_of_lines
from tactile_viewgcn.readers.source import (
    ATTRIBUTES_TOPIC,
    Form,
    Recording,
    columns_setting,
    label_text,
    setting,
)
from tactile_viewgcn.readers.windows import overlapping

DATASETS = ("pressure", "time", "valid", "grasp", "grasp_valid")
ATTRIBUTES = ("object", "session", "recording", "split")
OBJECTS_OF_WINDOWS = ("y", "label", "labels")  # names of arrays, in lower case
# the name of an array that labels frames, besides the names that `label_kind` knows
OBJECT_OF_FRAMES = "y"
AS_TABLE = "pandas.DataFrame(X).assign(label=y, recording=r).to_csv('all.csv', index=False)"
#: Python code that opens a file as arrays by their names; any other ending counts as HDF5.
OPENED = {".npz": "numpy.load({!r})", ".mat": "__import__('scipy.io').io.loadmat({!r})"}
OPENED_HDF5 = "__import__('h5py').File({!r})"


def recordings_of_arrays(file: Path, arrays: Mapping[str, Any], form: Form) -> list[Recording]:
    """Return the recordings in arrays: windows with labels, labelled frames, or else one recording.

    Args:
        file: the file, which errors name.
        arrays: the arrays by their names. The arrays of an `Hdf5File` are read when they are
            sliced.
        form: what the user says about the names.

    Raises:
        UserError: the file lacks a name that the form gives, or has different numbers of labels and
            windows.
    """
    attributes = _attributes(arrays)
    left_out = [name for name in form.left_out if name in arrays or name in attributes]
    recordings = windows_in(file, arrays, form)
    if not recordings:
        recordings = labelled_frames(file, arrays, form)
    if not recordings:
        recordings = [recording_of(file, arrays, form)]
    return [replace(recording, left_out=left_out) for recording in recordings]


def _attributes(arrays: Mapping[str, Any]) -> list[str]:
    """Return the names of the attributes that come with arrays; only HDF5 has any."""
    return arrays.attributes if isinstance(arrays, Hdf5File) else []


def recording_of(file: Path, arrays: Mapping[str, Any], form: Form) -> Recording:
    """Return the recording in arrays: `pressure` or the only array, and all that the form names.

    The recording of an HDF5 file has all datasets in `DATASETS`. Frames that read NaN are dropped
    if `valid` says that nothing is held.

    Raises:
        UserError: the file lacks an array or a name.
    """
    is_hdf5 = isinstance(arrays, Hdf5File)
    readings = [name for name in _of_readings(arrays) if name not in form.left_out]
    in_file = _names_in_file(readings, form, is_hdf5=is_hdf5)
    names = _named_by_attributes(arrays, in_file)
    values = dict[str, Any]()
    for kind in DATASETS:
        if in_file.get(kind, "") in arrays:
            values[kind] = arrays[in_file[kind]]
    for kind in ("pressure", *form.names):
        is_needed = form.labelled or kind not in ATTRIBUTES
        if is_needed and kind not in values and kind not in names:
            raise UserError(f"{file}: {_missing(file, arrays, kind, in_file[kind])}")
    if not is_hdf5:
        columns = {kind: np.ravel(array) for kind, array in values.items() if kind != "pressure"}
        values |= columns
    values, dropped = _without_unread_frames(values)
    notes = _attribute_notes(arrays, {*in_file.values(), *form.left_out}, names)
    return Recording(names, values, notes=notes, dropped=dropped)


def _of_readings(arrays: Mapping[str, Any]) -> list[str]:
    """Return the names of the arrays that can hold readings; for HDF5 there are none.

    Such an array has more than one axis longer than 1. In HDF5 the names tell what each dataset
    holds.
    """
    if isinstance(arrays, Hdf5File):
        return []
    return [name for name in arrays if _is_of_readings(arrays[name])]


def _is_of_readings(array: Any) -> bool:
    long_axes = [size for size in np.shape(array) if size > 1]
    return len(long_axes) > 1


def _names_in_file(readings: list[str], form: Form, *, is_hdf5: bool) -> dict[str, str]:
    """Return the names in a file by their content: the form's names, or else the usual names."""
    kinds = {"pressure", *ATTRIBUTES}
    if is_hdf5:
        kinds.update(DATASETS)
    in_file = {kind: kind for kind in kinds.difference(form.left_out)}
    in_file |= form.names
    if "pressure" not in form.names and len(readings) == 1:
        in_file["pressure"] = readings[0]
    return in_file


def _named_by_attributes(arrays: Mapping[str, Any], in_file: Mapping[str, str]) -> dict[str, str]:
    """Return the names of a recording that HDF5 attributes give."""
    names = dict[str, str]()
    if isinstance(arrays, Hdf5File):
        for kind in ATTRIBUTES:
            if in_file.get(kind, "") in arrays.attributes:
                names[kind] = arrays.attribute(in_file[kind])
    return names


def _without_unread_frames(values: dict[str, Any]) -> tuple[dict[str, Any], int]:
    """Drop the frames that read NaN while nothing is held.

    Returns:
        The remaining values, and the number of dropped frames. If frames were dropped, the values
        have a column `frame` with the numbers of the remaining frames.
    """
    counts = values["pressure"]
    has_flags = "valid" in values and values["valid"].shape == counts.shape[:1]
    if not has_flags or counts.dtype.kind != "f":
        return values, 0
    unread = np.isnan(counts[()]).any(axis=tuple(range(1, counts.ndim)))
    held = values["valid"][()] != 0
    stays = np.flatnonzero(held | ~unread)
    dropped = len(counts) - len(stays)
    if dropped:
        values = {name: array[()][stays] for name, array in values.items()}
        values["frame"] = stays
    return values, dropped


def _attribute_notes(
    arrays: Mapping[str, Any], used: set[str], names: dict[str, str]
) -> list[Note]:
    """Return a note on the attributes that are not used, if none of them names the object."""
    unused = [name for name in _attributes(arrays) if name not in used]
    if not unused or "object" in names:
        return []
    remedy = columns_setting(f"object:{unused[0]}")
    text = f"attributes that are not used: {listed(unused)}; if one names the object, {remedy}"
    return [Note(text, topic=ATTRIBUTES_TOPIC)]


def _missing(file: Path, arrays: Mapping[str, Any], kind: str, name: str) -> str:
    """Return a text that names a missing array or attribute, with the remedy to type.

    Args:
        file: the file.
        arrays: its arrays.
        kind: the content that is missing, such as `pressure`.
        name: the name that this content should have in the file.
    """
    found = arrays.everywhere() if isinstance(arrays, Hdf5File) else [*arrays]
    if kind not in DATASETS and name in found:
        length = len(np.ravel(arrays[name]))
        return (
            f"array {name} of {length:,} values is no attribute; to label each frame, save a "
            f"table with a line for each frame and the columns {name} and `recording`: "
            f"{AS_TABLE}"
        )
    text = f"no array {name}; found {listed(found) or 'none'}"
    if kind in ATTRIBUTES and isinstance(arrays, Hdf5File):
        text += f"; attributes {listed(arrays.attributes) or 'none'}"
    readings = [path for path in found if _is_of_readings(arrays[path])]
    if kind == "pressure" and readings:
        text += f"; if one holds the readings, {columns_setting(f'pressure:{readings[0]}')}"
    elif kind not in DATASETS:
        text += f"; {setting(f'data.columns=[{kind}:NAME]')}"
    if kind == "pressure" and len(readings) > 1:
        text += f"; if each is a recording, save each as a file of its own: {as_files(file)}"
    return text


def as_files(file: Path) -> str:
    """Return the command that saves each array of a file as .npy, next to the file."""
    opened = OPENED.get(file.suffix.lower(), OPENED_HDF5).format(file.name)
    code = "import numpy; "
    code += f"[numpy.save(n + '.npy', a) for n, a in {opened}.items() if numpy.ndim(a) > 1]"
    return f'cd {quote(str(file.parent))} && python -c "{code}"'


def windows_in(file: Path, arrays: Mapping[str, Any], form: Form) -> list[Recording]:
    """Return the windows X (n, T, C) or (n, T, H, W) with labels y (n,), each as a recording.

    A window that overlaps the window before belongs to the same take, see `overlapping`. An array
    (n,) with the name of a session gives the sessions. Without labels there are no windows.

    Raises:
        UserError: the numbers of windows and labels differ.
    """
    label_name = _label_of_windows(arrays, form)
    if "pressure" in arrays or label_name not in arrays:
        return []
    labels = [label_text(label) for label in np.ravel(arrays[label_name]).tolist()]
    candidates = [name for name in arrays if getattr(arrays.get(name), "ndim", 0) > 2]
    fitting = [name for name in candidates if len(arrays[name]) == len(labels) > 0]
    if len(fitting) != 1:
        is_label = len(labels) > 1 and np.ndim(arrays[label_name]) == 1
        if is_label and not fitting and len(candidates) == 1:
            windows = f"{candidates[0]} has {len(arrays[candidates[0]]):,} windows"
            counts = f"{windows} and {label_name} {len(labels):,} labels"
            raise UserError(f"{file}: {counts}; save a label for each window")
        return []
    name = fitting[0]
    if list(arrays[name].shape[1:]) == list(form.shape):  # these are frames, not windows
        return []
    windows = arrays[name][()]
    takes = np.cumsum([0, *~overlapping(windows)]).tolist()
    note = _windows_note(name, windows, label_name, takes[-1] + 1)
    sessions = _sessions_of_windows(arrays, len(windows))
    recordings = list[Recording]()
    for number, window in enumerate(windows):
        names = {
            "recording": f"{file.stem}/{number}",
            "object": labels[number],
            "take": f"{file}/{takes[number]}",
        }
        if sessions:
            names["session"] = sessions[number]
        recordings.append(Recording(names, {"pressure": window}, notes=[note], place=str(number)))
    return recordings


def _label_of_windows(arrays: Mapping[str, Any], form: Form) -> str:
    """Return the name of the array that labels windows: the form's, or else a usual name, or ""."""
    if form.names.get("object"):
        return form.names["object"]
    for name in arrays:
        if name.lower() in OBJECTS_OF_WINDOWS:
            return name
    return ""


def _windows_note(name: str, windows: np.ndarray, label_name: str, takes: int) -> Note:
    count, length = windows.shape[:2]
    text = f"{name} holds {count:,} windows of {length} frames, labelled by {label_name}"
    if takes < count:
        text += f"; windows that overlap are held out together, as {several(takes, 'recording')}"
    return Note(text, topic="windows")


def _sessions_of_windows(arrays: Mapping[str, Any], count: int) -> list[str]:
    """Return the sessions of `count` windows, from the first array named so; or an empty list."""
    shapes = ((count,), (count, 1), (1, count))
    for name in arrays:
        if label_kind(name) == "session" and np.shape(arrays[name]) in shapes:
            return [label_text(label) for label in np.ravel(arrays[name]).tolist()]
    return []


def labelled_frames(file: Path, arrays: Mapping[str, Any], form: Form) -> list[Recording]:
    """Return the recordings in one array X (T, C) with a label y (T,) for each frame; or none.

    Arrays (T,) with the name of a session or a recording divide the frames too. An array `time` is
    kept. See `recordings_of_lines`.
    """
    kinds = _kinds_of_labels(arrays, form)
    large = [
        name for name in arrays if np.ndim(arrays[name]) == 2 and min(np.shape(arrays[name])) > 1
    ]
    if len(large) != 1 or "object" not in kinds.values() or "pressure" in arrays:
        return []
    frames = len(arrays[large[0]])
    columns = {
        name: np.ravel(arrays[name]) for name in arrays if np.size(arrays[name]) == frames > 1
    }
    labels = dict[str, np.ndarray]()
    for name, column in columns.items():
        kind = kinds[name]
        if kind in LABELS and kind not in labels:
            texts = [label_text(label) for label in column.tolist()]
            labels[kind] = np.array(texts, dtype=object)
    if "object" not in labels or len(set(labels["object"])) < 2:
        return []
    values = {"pressure": arrays[large[0]][()]}
    if "time" in columns:
        values["time"] = columns["time"]
    text = f"{large[0]} holds {several(frames, 'frame')}, each with its label"
    table = Recording({}, values, notes=[Note(text, topic="labels of frames")], labels=labels)
    return recordings_of_lines(table, file.stem)


def _kinds_of_labels(arrays: Mapping[str, Any], form: Form) -> dict[str, str]:
    """Return the kind of label in each array: `object`, `session`, `recording`, or "" for none."""
    kinds = dict[str, str]()
    of_form = form.names.get("object", "")
    for name in arrays:
        kind = label_kind(name)
        if not kind and name.lower() == OBJECT_OF_FRAMES:
            kind = "object"
        if of_form in arrays and kind == "object":
            kind = ""
        kinds[name] = kind
    if of_form in arrays:
        kinds[of_form] = "object"
    return kinds
