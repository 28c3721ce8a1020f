"""Reading arrays: .npy, .npz, MATLAB and HDF5, each as a mapping of arrays by their names; and STAG's files.

An array is (frames, rows, columns), or (frames, cells) with the cells row after row. With a shape
(rows and columns of a frame) it may also be one frame; without one, (frames, cells) are frames of
one row.

HDF5 holds one recording:

/pressure     (T, H, W)  integer counts or real numbers, up to 256 x 256 /time         (T,)
seconds, optional /valid        (T,)       whether the object is held, optional /grasp        (T,)
number of the grasp, optional /grasp_valid  (T,)       whether the frame is in the steady part of
its grasp, optional attributes    object, session; optional: recording (else the file's path in the
folder), split ("train" or "test")

The fields of STAG's files follow the descriptions that come with the data set of Sundaram et al.,
"Learning the signatures of the human grasp using a scalable tactile glove", Nature 569, 698-702
(2019). All indices are zero-based, per-frame fields are column vectors (T, 1), names are cell
arrays (1, K).
"""

import re
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import prod
from os import SEEK_CUR
from pathlib import Path
from shlex import quote
from struct import unpack
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.messages import Note, UserError, listed, several
from tactile_viewgcn.readers.child import check_unpacked, library
from tactile_viewgcn.readers.join import check_values
from tactile_viewgcn.readers.source import (
    ATTRIBUTES_TOPIC,
    NUMBERS,
    Form,
    Recording,
    Source,
    Values,
    label_text,
    setting,
    side_of,
    sliced,
)
from tactile_viewgcn.readers.text import LABELS, label_kind, recordings_in

DATASETS = ("pressure", "time", "valid", "grasp", "grasp_valid")
ATTRIBUTES = ("object", "session", "recording", "split")
# fewest readings that change from a frame to the next, in the frames that two windows share
OVERLAP_CHANGES = 3
CACHE = 64 * 2**20  # bytes of a chunk that is kept for the next block
IN_A_GROUP = "one in a group as GROUP/ARRAY"
MATLAB5_HEADER, MATLAB5_TAG = 128, 8  # bytes
MATLAB5_COMPRESSED = 15  # kind of an element
BEGINNING = 2048  # bytes of a compressed element that hold its first eight bytes
OF_LABELS = {"y": "object"}  # beside the words of `label_kind`
AS_TABLE = "pandas.DataFrame(X).assign(label=y, recording=r).to_csv('all.csv', index=False)"
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

    Raises:
        UserError: the file is damaged, unpacks to more than a file of its size may, or lacks what
            the form names.
    """
    match file.suffix.lower():
        case ".npy":
            arrays: Mapping[str, Any] = {form.names.get("pressure", "pressure"): _mapped(file)}
        case ".npz":
            arrays = _unpacked(file)
        case ".mat":
            arrays = matlab_fields(file)
        case _:
            arrays = Hdf5File(file)
    left = [name for name in form.left_out if name in arrays or name in _attributes(arrays)]
    recordings = windows_in(file, arrays, form) or labelled_frames(file, arrays, form)
    recordings = recordings or [recording_of(file, arrays, form)]
    return [replace(recording, left_out=left) for recording in recordings]


def _mapped(file: Path) -> np.ndarray:
    """The array of a .npy file, memory-mapped."""
    with library(file):
        array = np.load(file, mmap_mode="r", allow_pickle=False)
    if not isinstance(array, np.memmap) or array.offset + array.nbytes != file.stat().st_size:
        raise UserError(
            f"{file}: there are more bytes after the array; save it again, alone in its file"
        )
    return array


def _unpacked(file: Path) -> dict[str, np.ndarray]:
    """The arrays of a .npz file, whose members' sizes are checked before one is unpacked."""
    with library(file), zipfile.ZipFile(file) as archive:
        size = sum(member.file_size for member in archive.infolist())
    check_unpacked(file, size)
    with library(file), np.load(file, allow_pickle=False) as stored:
        return dict(stored)


class Hdf5Array:
    """A dataset of an HDF5 file, read when it is sliced.

    Args:
        file: its path, which errors name.
        dataset: of h5py.

    Raises:
        UserError: `dataset` is a group or empty, or declares far more than its file stores; later,
            where it is damaged.
    """

    def __init__(self, file: Path, dataset: Any):
        if not isinstance(dataset, h5py.Dataset):
            raise UserError(
                f"{file}: {shown_path(dataset)} is of another form; expected an array, {IN_A_GROUP}"
            )
        with library(file):
            self.name, shape, self.dtype = dataset.name, dataset.shape, dataset.dtype
            chunk = dataset.chunks
        if shape is None:
            raise UserError(f"{file}: {self.name} is empty; expected an array")
        self.shape: tuple[int, ...] = shape
        self.ndim = len(shape)
        self._file = file
        self._dataset = dataset
        self._whole: np.ndarray | None = None
        self._is_one_chunk = chunk is not None and prod(chunk) * self.dtype.itemsize > CACHE
        check_unpacked(file, prod(shape) * self.dtype.itemsize)

    def __len__(self) -> int:
        return self.shape[0] if self.shape else 0

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self[()], dtype=dtype)

    def __getitem__(self, index: Any) -> Any:
        if not self._is_one_chunk:
            with library(self._file):
                return self._dataset[index]
        # a chunk beyond HDF5's cache would be unpacked again for each block of frames
        if self._whole is None:
            with library(self._file):
                self._whole = self._dataset[()]
        return self._whole[index]


class Hdf5File(Mapping[str, Hdf5Array]):
    """The datasets of an HDF5 file at its top, by their names, which may come from anybody.

    A name of a dataset in a group is found too. Attributes are those of the file.

    Raises:
        UserError: it is damaged, or a link leads out of it, or values lie elsewhere.
    """

    def __init__(self, path: Path):
        self.path = path
        with library(path):
            self.file = h5py.File(path, "r", rdcc_nbytes=CACHE)
        items = list[tuple[str, Any]]()
        with library(path):
            self.file.visititems_links(lambda *item: items.append(item))
            self.file.visititems(lambda *item: items.append(item))
        for name, item in items:
            if _leads_out(path, item):
                raise UserError(f"{path}: /{name} leads out of the file; expected it in the file")

    def __getitem__(self, name: str) -> Hdf5Array:
        with library(self.path):
            found = self.file.get(name) if name else None
        if found is None:
            raise KeyError(name)
        return Hdf5Array(self.path, found)

    def __iter__(self) -> Iterator[str]:
        with library(self.path):
            names = [name for name, item in self.file.items() if isinstance(item, h5py.Dataset)]
        return iter(names)

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        with library(self.path):
            # a dead link is there, and leads to nothing
            return bool(name) and self.file.get(name) is not None

    @property
    def attributes(self) -> list[str]:
        """Names of the file's attributes."""
        with library(self.path):
            return [str(name) for name in self.file.attrs]

    def attribute(self, name: str) -> str:
        """An attribute, one text or number, as text."""
        with library(self.path):
            value = np.asarray(self.file.attrs[name]).item()
            return value.decode() if isinstance(value, bytes) else str(value)

    def everywhere(self) -> list[str]:
        """The paths of all datasets, those in groups too."""
        paths = list[str]()
        with library(self.path):
            self.file.visititems(
                lambda name, item: paths.append(name) if isinstance(item, h5py.Dataset) else None
            )
        return paths


def shown_path(item: Any) -> str:
    """The path of a group or of a dataset in its file."""
    return str(getattr(item, "name", item))


def _attributes(arrays: Mapping[str, Any]) -> list[str]:
    """Names of the attributes beside arrays; only HDF5 has them."""
    return arrays.attributes if isinstance(arrays, Hdf5File) else []


def recording_of(file: Path, arrays: Mapping[str, Any], form: Form) -> Recording:
    """The recording in arrays: `pressure` or the only array, and what the form names; all datasets of HDF5.

    Frames that read NaN are dropped if `valid` says that nothing is held. A UserError names what
    the file lacks.
    """
    is_hdf5 = isinstance(arrays, Hdf5File)
    attributes = _attributes(arrays)
    kinds = {*(DATASETS if is_hdf5 else DATASETS[:1]), *ATTRIBUTES}.difference(form.left_out)
    in_file = {kind: kind for kind in kinds} | form.names
    large = (
        []
        if is_hdf5
        else [name for name in arrays if sum(size > 1 for size in np.shape(arrays[name])) > 1]
    )
    large = [name for name in large if name not in form.left_out]
    if "pressure" not in form.names and len(large) == 1:
        in_file["pressure"] = large[0]
    names = dict[str, str]()
    for kind in ATTRIBUTES:
        if isinstance(arrays, Hdf5File) and in_file.get(kind, "") in attributes:
            names[kind] = arrays.attribute(in_file[kind])
    values = dict[str, Any]()
    for kind in DATASETS:
        if in_file.get(kind, "") in arrays:
            values[kind] = arrays[in_file[kind]]
    for kind in ("pressure", *form.names):
        is_needed = form.labelled or kind not in ATTRIBUTES
        if kind not in {*values, *names} and is_needed:
            raise UserError(f"{file}: {_missing(file, arrays, kind, in_file[kind], large)}")
    if not is_hdf5:
        values |= {kind: np.ravel(array) for kind, array in values.items() if kind != "pressure"}
    counts, dropped = values["pressure"], 0
    if "valid" in values and counts.dtype.kind == "f" and values["valid"].shape == counts.shape[:1]:
        unread = np.isnan(counts[()]).any(axis=tuple(range(1, counts.ndim)))
        kept = np.flatnonzero((values["valid"][()] != 0) | ~unread)
        dropped = len(counts) - len(kept)
        if dropped:
            values = {name: array[()][kept] for name, array in values.items()} | {"frame": kept}
    unused = [name for name in attributes if name not in {*in_file.values(), *form.left_out}]
    notes = list[Note]()
    if unused and "object" not in names:
        remedy = setting(f"data.columns=[object:{unused[0]}]")
        text = f"attributes that are not used: {listed(unused)}; if one names the object, {remedy}"
        notes.append(Note(text, topic=ATTRIBUTES_TOPIC))
    return Recording(names, values, notes=notes, dropped=dropped)


def _missing(file: Path, arrays: Mapping[str, Any], kind: str, name: str, large: list[str]) -> str:
    """What a file of arrays lacks, and what to type: for `kind`, which the form has under `name`."""
    found = arrays.everywhere() if isinstance(arrays, Hdf5File) else [*arrays]
    if kind not in DATASETS and name in found:
        length = len(np.ravel(arrays[name]))
        return (
            f"array {name} of {length:,} values is no attribute; a label for each frame belongs into a table, a line "
            f"for each frame with the columns {name} and `recording`: {AS_TABLE}"
        )
    text = f"no array {name}; found {listed(found) or 'none'}"
    if kind in ATTRIBUTES and isinstance(arrays, Hdf5File):
        text += f"; attributes {listed(arrays.attributes) or 'none'}"
    of_readings = [path for path in found if sum(size > 1 for size in np.shape(arrays[path])) > 1]
    if kind == "pressure" and of_readings:
        text += f"; if one has the readings, {setting(f'data.columns=[pressure:{of_readings[0]}]')}"
    elif kind not in DATASETS:
        text += f"; {setting(f'data.columns=[{kind}:NAME]')}"
    if kind == "pressure" and len(of_readings) > 1:
        text += f"; if each is a recording, save each as a file of its own: {as_files(file)}"
    return text


def as_files(file: Path) -> str:
    """The line to type that saves each array of a file as .npy, in a folder beside it."""
    load = {".npz": "numpy.load({!r})", ".mat": "__import__('scipy.io').io.loadmat({!r})"}
    opened = load.get(file.suffix.lower(), "__import__('h5py').File({!r})").format(file.name)
    code = f"import numpy; [numpy.save(n + '.npy', a) for n, a in {opened}.items() if numpy.ndim(a) > 1]"
    return f'cd {quote(str(file.parent))} && python -c "{code}"'


def windows_in(file: Path, arrays: Mapping[str, Any], form: Form) -> list[Recording]:
    """The windows X (n, T, C) or (n, T, H, W) among arrays with labels y (n,), a recording each; none without labels.

    A window that overlaps the one before is of the same take, see `overlapping`. An array (n,) that
    is called as a session names the sessions.

    Raises:
        UserError: there are other numbers of windows and labels.
    """
    name = form.names.get("object") or next(
        (each for each in arrays if each.lower() in ("y", "label", "labels")), ""
    )
    if "pressure" in arrays or name not in arrays:
        return []
    labels = [label_text(label) for label in np.ravel(arrays[name]).tolist()]
    arrays_of_windows = [key for key in arrays if getattr(arrays.get(key), "ndim", 0) > 2]
    large = [key for key in arrays_of_windows if len(arrays[key]) == len(labels) > 0]
    if len(large) != 1 or [*arrays[large[0]].shape[1:]] == [*form.shape]:
        is_label = len(labels) > 1 and np.ndim(arrays[name]) == 1
        if is_label and not large and len(arrays_of_windows) == 1:
            windows = f"{arrays_of_windows[0]} has {len(arrays[arrays_of_windows[0]]):,} windows"
            raise UserError(
                f"{file}: {windows} and {name} {len(labels):,} labels; save a label for each window"
            )
        return []
    X = arrays[large[0]][()]
    sessions = _sessions_of_windows(arrays, len(X))
    takes = np.cumsum([0, *~overlapping(X)]).tolist()
    text = f"{large[0]} holds {len(X):,} windows of {X.shape[1]} frames, labelled by {name}"
    if takes[-1] + 1 < len(X):
        text += f"; windows that overlap are held out together, as {several(takes[-1] + 1, 'recording')}"
    note = Note(text, topic="windows")
    recordings = list[Recording]()
    for at, (window, label, take) in enumerate(zip(X, labels, takes, strict=True)):
        names = {"recording": f"{file.stem}/{at}", "object": label, "take": f"{file}/{take}"}
        if sessions:
            names["session"] = sessions[at]
        recordings.append(Recording(names, {"pressure": window}, notes=[note]))
    return recordings


def _sessions_of_windows(arrays: Mapping[str, Any], count: int) -> list[str]:
    """The session of each of `count` windows by the first array (n,) that is called as one; none without any."""
    for name in arrays:
        if label_kind(name) == "session" and np.shape(arrays[name]) in (
            (count,),
            (count, 1),
            (1, count),
        ):
            return [label_text(label) for label in np.ravel(arrays[name]).tolist()]
    return []


def labelled_frames(file: Path, arrays: Mapping[str, Any], form: Form) -> list[Recording]:
    """The recordings in one array X (T, C) with a label y (T,) for each frame, see `recordings_in`; none without both.

    Arrays (T,) that are called as a session or a recording part the frames too, and a `time` is
    kept.
    """
    kinds = {name: label_kind(name) or OF_LABELS.get(name.lower(), "") for name in arrays}
    if form.names.get("object", "") in arrays:
        kinds = {name: kind for name, kind in kinds.items() if kind != "object"} | {
            form.names["object"]: "object"
        }
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
        if kinds[name] in LABELS:
            labels.setdefault(
                kinds[name],
                np.array([label_text(label) for label in column.tolist()], dtype=object),
            )
    if "object" not in labels or len(set(labels["object"])) < 2:
        return []
    values = {"pressure": arrays[large[0]][()]}
    if "time" in columns:
        values["time"] = columns["time"]
    note = Note(
        f"{large[0]} holds {several(frames, 'frame')}, each with its label",
        topic="labels of frames",
    )
    return recordings_in(Recording({}, values, notes=[note]), labels, file.stem)


def overlapping(X: np.ndarray) -> np.ndarray:
    """Whether each window (n, T, ...) but the first overlaps the one before: bool (n - 1,).

    The last frames of the one before are its first frames, two at least, and three readings change
    in them. Frames at rest and padding are alike in all windows: equal frames that do not change
    are no overlap.
    """
    from pandas import DataFrame  # here, since it loads slowly
    from pandas.util import hash_pandas_object

    count, length = X.shape[:2]
    frames = X.reshape(count, length, -1)
    # equal of equal frames
    numbers = hash_pandas_object(DataFrame(frames.reshape(count * length, -1)), index=False)
    numbers = numbers.to_numpy().reshape(count, length)
    before, after = numbers[:-1], numbers[1:]
    changed = np.count_nonzero(frames[1:, 1:] != frames[1:, :-1], axis=2)
    changes = np.cumsum(changed, axis=1)  # up to the second frame, the third and so on
    # of short windows all but one frame's
    least = max(1, min(OVERLAP_CHANGES, (length - 2) * frames.shape[2]))
    is_first = before == after[:, :1]  # frames of the one before that are the first of the next
    is_last = after == before[:, -1:]  # frames of the next that are the last of the one before
    overlaps = np.zeros(len(after), dtype=bool)
    for shared in range(2, length + 1):
        may_overlap = (
            is_first[:, length - shared]
            & is_last[:, shared - 1]
            & (changes[:, shared - 2] >= least)
        )
        rows = np.flatnonzero(may_overlap & ~overlaps)
        overlaps[rows] = (before[rows, length - shared :] == after[rows, :shared]).all(axis=1)
    return overlaps


def matlab_fields(path: Path) -> dict[str, Any]:
    """The fields of a MAT-file that are numbers, with MATLAB's axes, or cell arrays of texts, as lists.

    Files of MATLAB 7.3 are HDF5 with reversed axes; SciPy reads the older ones.
    """
    if h5py.is_hdf5(path):
        file = Hdf5File(path)
        check_unpacked(
            path, sum(prod(file[name].shape) * file[name].dtype.itemsize for name in file)
        )
        fields = {name: _of_matlab73(file, name) for name in file}
    else:
        from scipy import io  # here, since it loads slowly

        check_unpacked(path, _declared_by_matlab5(path))
        with library(path):
            loaded = io.loadmat(path)
        fields = {name: _of_matlab5(value) for name, value in loaded.items()}
    return {name: value for name, value in fields.items() if value is not None}


def _declared_by_matlab5(path: Path) -> int:
    """Bytes of all elements of a MAT-file 5, of compressed ones what they declare inside; 0 of other files.

    See MathWorks' "MAT-File Format": a header, then elements of a tag, kind and length, and their
    bytes.
    """
    size = 0
    with path.open("rb") as stream:
        order = {b"IM": "<", b"MI": ">"}.get(stream.read(MATLAB5_HEADER)[-2:])
        tag = stream.read(MATLAB5_TAG)
        while order and len(tag) == MATLAB5_TAG:
            kind, length = unpack(f"{order}II", tag)
            inside = b""
            if kind == MATLAB5_COMPRESSED:
                beginning = stream.read(min(length, BEGINNING))
                length -= len(beginning)
                with library(path):
                    inside = zlib.decompressobj().decompress(beginning, MATLAB5_TAG)
            if len(inside) == MATLAB5_TAG:
                size += unpack(f"{order}II", inside)[1]
            stream.seek(length, SEEK_CUR)
            size += length
            tag = stream.read(MATLAB5_TAG)
    return size


def _of_matlab5(value: Any) -> Any:
    """Numbers, or the texts of a cell array; None of any other value."""
    kind = value.dtype.kind if isinstance(value, np.ndarray) else ""
    cells = [np.asarray(cell) for cell in value.ravel(order="F")] if kind == "O" else []
    if kind == "O" and all(cell.dtype.kind == "U" for cell in cells):
        return [str(cell.ravel()[0]) if cell.size else "" for cell in cells]
    return value if kind and kind in NUMBERS else None


def _of_matlab73(file: Hdf5File, name: str) -> Any:
    """Numbers, or the texts of a cell array, which holds references to arrays of character codes; else None."""
    values = file[name]
    with library(file.path):
        dataset = file.file[name]
        is_text = dataset.attrs.get("MATLAB_class") == b"char"
        is_cells = h5py.check_ref_dtype(dataset.dtype) is h5py.Reference
    if is_text:
        return None
    if values.dtype.kind in NUMBERS:
        return values[()].T
    if not is_cells:
        return None
    with library(file.path):
        cells = [file.file[reference] for reference in np.ravel(values[()])]
        are_texts = all(getattr(cell, "dtype", None) == np.uint16 for cell in cells)
    if not are_texts:
        return None
    # where no name leads to it, `Hdf5File` does not visit it
    if any(_leads_out(file.path, cell) for cell in cells):
        raise UserError(
            f"{file.path}: a cell of {name} leads out of the file; expected it in the file"
        )
    check_unpacked(file.path, sum(prod(cell.shape or ()) for cell in cells) * 2)
    with library(file.path):
        return [cell[()].ravel().astype("<u2").tobytes().decode("utf-16-le") for cell in cells]


def _leads_out(path: Path, item: Any) -> bool:
    """Whether a link or a dataset leads out of its file."""
    with library(path):
        is_elsewhere = getattr(item, "is_virtual", False) or getattr(item, "external", None)
    return isinstance(item, h5py.ExternalLink) or bool(is_elsewhere)


def read_raw(file: Path) -> Recording:
    """The raw recording of STAG in a file; its object is the folder's name without number: "003-tea_box" is tea_box."""
    session, name = file.parts[-3:-1]
    names = {
        "object": re.sub(r"^\d+-", "", name),
        "recording": f"{session}/{name}",
        "session": session,
    }
    return Recording(names, _values(matlab_fields(file)))


def read_metadata(path: Path) -> Source:
    """The source of a `metadata.mat`; a UserError if a field is missing, or of the wrong length or kind."""
    fields = {
        name: field
        for name, field in matlab_fields(path).items()
        if isinstance(field, list) == (name in NAMES)
    }
    if missing := [name for name in REQUIRED if name not in fields]:
        what = f"no field {', '.join(missing)}; found {listed(list(fields)) or 'nothing'}"
        raise UserError(f"{path}: {what}; if cut short, download it again")
    values = _values(fields)
    shape, dtype = check_values(values, str(path))
    if "split" in values:
        names = fields.get("splits", ["train", "test"])
        sides = dict(enumerate(map(side_of, names)))
        values["split"] = np.array([sides.get(number) for number in values["split"].tolist()])
        if None in values["split"]:
            raise UserError(
                f"{path}: splitId and splits {listed(names)}; expected numbers of train and test in it"
            )
    ids = {
        "object": fields["objects"],
        "recording": fields["recordings"],
        "session": fields["batches"],
    }
    return Source(
        path, ids, shape, dtype, len(values["pressure"]), sliced(values, len(values["pressure"]))
    )


def _values(fields: dict[str, Any]) -> Values:
    """Pressure (T, H, W) and the columns (T,) that the fields of a file hold."""
    values = {
        column: np.ravel(fields[name]) for name, column in COLUMN_OF_FIELD.items() if name in fields
    }
    return {"pressure": fields["pressure"]} | values
