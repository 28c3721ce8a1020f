"""Reading STAG's files: metadata.mat (MATLAB 5 or 7.3) and folders of pressuredata.mat.

The fields follow the descriptions that come with the data set of Sundaram et al., "Learning the signatures of
the human grasp using a scalable tactile glove", Nature 569, 698-702 (2019). All indices are zero-based,
per-frame fields are column vectors (T, 1), names are cell arrays (1, K).
"""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.recordings import BLOCK, TEST, TRAIN, Source, check_shape, refuse, storage_type

REQUIRED = ("pressure", "objectId", "objects", "recordingId", "recordings", "batchId", "batches")
RAW = ("pressure", "tStamp", "frame")  # of a raw recording
NAMES = ("objects", "recordings", "batches", "splits")
#: STAG's field -> our column
FIELDS = {
    "objectId": "object",
    "recordingId": "recording",
    "batchId": "session",
    "frame": "frame",
    "ts": "time",
    "splitId": "split",
    "hasValidLabel": "valid",
    "isBalanced": "balanced",
    "isTransition": "transition",
    "isGrap": "grip",
    "graspIndex": "grasp",
    "graspValid": "grasp_valid",
}
PER_ENTRY = {"weights": "objects", "actionStartTS": "recordings", "actionEndTS": "recordings"}  # a value for each


def read_metadata(path: Path) -> Source:
    """A `metadata.mat`, in MATLAB 5 form or re-saved as MATLAB 7.3.

    Raises:
        ValueError: not a MAT-file, truncated, a field missing or of the wrong length or kind.
    """
    read = _read_hdf5 if h5py.is_hdf5(path) else _read_matlab5
    shape, pressure, fields = read(path)
    check_shape(shape, str(path))
    frames = shape[0]
    for name, among in PER_ENTRY.items():
        if name in fields and fields[name].size != len(fields[among]):
            values, count = fields[name].size, len(fields[among])
            raise ValueError(f"{path}: {name} has {values} values; expected one per entry of {among}, {count}")
    columns = {column: _column(fields[name], name, frames, path) for name, column in FIELDS.items() if name in fields}
    columns.setdefault("frame", np.arange(frames))
    columns.setdefault("time", np.full(frames, np.nan))
    if "split" in columns:
        columns["split"] = _published_split(columns["split"], fields.get("splits"), path)
    starts, ends = fields.get("actionStartTS"), fields.get("actionEndTS")
    action = None if starts is None or ends is None else np.stack([starts.ravel(), ends.ravel()], axis=1)

    def blocks() -> Iterator[dict[str, np.ndarray]]:
        for start in range(0, frames, BLOCK):
            at = slice(start, start + BLOCK)
            yield {"pressure": pressure(at), **{name: values[at] for name, values in columns.items()}}

    return Source(
        path,
        fields["objects"],
        fields["recordings"],
        fields["batches"],
        shape[1:],
        storage_type(pressure(slice(0, 0)).dtype, str(path)),
        blocks(),
        weights=None if "weights" not in fields else fields["weights"].ravel(),
        action=action,
    )


def _need(found: list[str], path: Path) -> None:
    missing = [name for name in REQUIRED if name not in found]
    if missing:
        raise ValueError(
            f"{path}: no field {', '.join(missing)}; found {', '.join(found) or 'nothing'}; "
            "expected STAG's metadata.mat, and not cut short: download it again"
        )


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """For reading alone, no checks: a damaged file fails in SciPy and zlib in a dozen ways."""
    try:
        yield
    except Exception as error:
        raise ValueError(
            f"{path}: not a readable MAT-file, or cut short ({type(error).__name__}: "
            f"{' '.join(str(error).split())}); expected MATLAB 5 or 7.3; download it again"
        ) from None


def _read_matlab5(path: Path) -> tuple[tuple, Any, dict[str, Any]]:
    from scipy import io

    with _readable(path):
        shapes = {name: shape for name, shape, _ in io.whosmat(str(path))}
    _need(list(shapes), path)
    check_shape(shapes["pressure"], str(path))  # before the large array is read
    wanted = [name for name in (*REQUIRED, *FIELDS, *NAMES, *PER_ENTRY) if name in shapes]
    with _readable(path):
        tree = io.loadmat(str(path), variable_names=wanted)
    pressure = tree.pop("pressure")
    fields = {
        name: [str(np.squeeze(cell)) for cell in value.ravel()] if name in NAMES else value
        for name, value in tree.items()
        if not name.startswith("__")
    }
    return pressure.shape, lambda at: np.ascontiguousarray(pressure[at]), fields


def _read_hdf5(path: Path) -> tuple[tuple, Any, dict[str, Any]]:
    """MATLAB 7.3 is HDF5 with reversed axes; a cell array holds references to arrays of character codes."""
    with _readable(path):
        file = h5py.File(path, "r")
        found = {name: file[name] for name in file if not name.startswith("#")}
    _need(list(found), path)
    used = {name: found[name] for name in (*REQUIRED, *FIELDS, *NAMES, *PER_ENTRY) if name in found}
    for name, dataset in used.items():
        if not isinstance(dataset, h5py.Dataset):
            raise ValueError(f"{path}: {name} is a structure; expected an array")
        if name in NAMES and h5py.check_ref_dtype(dataset.dtype) is None:
            raise ValueError(f"{path}: {name} is of type {dataset.dtype}; expected a cell array of names")
    pressure = used.pop("pressure")
    with _readable(path):
        fields = {name: _texts(file, dataset) if name in NAMES else dataset[()].T for name, dataset in used.items()}
    reverse = tuple(range(pressure.ndim))[::-1]
    return pressure.shape[::-1], lambda at: pressure[..., at].transpose(reverse), fields


def _texts(file: h5py.File, cells: h5py.Dataset) -> list[str]:
    """The texts of a cell array."""
    return ["".join(map(chr, file[reference][()].ravel())) for reference in cells[()].ravel()]


def _column(values: np.ndarray, name: str, frames: int, path: Path) -> np.ndarray:
    """A per-frame field as (T,)."""
    if values.size != frames:
        raise ValueError(f"{path}: {name} has {values.size} values; expected one per frame, {frames}")
    if values.dtype.kind not in "biuf":
        raise ValueError(f"{path}: {name} is of type {values.dtype}; expected numbers")
    values = values.ravel()
    if name in ("ts", "tStamp"):
        return values
    whole = values.astype(np.int64) if np.isfinite(values).all() else None
    if whole is None or (whole != values).any():
        raise ValueError(f"{path}: {name} holds values that are no whole numbers; expected indices or flags")
    return whole


def _published_split(ids: np.ndarray, names: list[str] | None, path: Path) -> np.ndarray:
    """splitId as TRAIN or TEST, by the names that the file gives them."""
    codes = {"train": TRAIN, "test": TEST}
    names = names or ["train", "test"]
    used = np.unique(ids)
    if used.size and (used[0] < 0 or used[-1] >= len(names)):
        raise ValueError(f"{path}: splitId is {used.tolist()}; expected 0 to {len(names) - 1}")
    unknown = [names[i] for i in used if names[i] not in codes]
    if unknown:
        raise ValueError(f"{path}: splits has {', '.join(unknown)}; expected train and test")
    return np.array([codes.get(name, -1) for name in names])[ids]


def read_folder(path: Path) -> Source:
    """A STAG folder `[batch]/[recording]/pressuredata.mat`, read one recording at a time.

    A recording's object is its name without the number ("003-tea_box" holds tea_box). The raw recordings
    carry no flags and no split; objects are numbered in the order of their names, the empty hand first.

    Raises:
        ValueError: no recordings, or mistakes in the kinds and shapes of their fields, which are looked at in all
            files before any is read; the sentence lists them. Other damage shows when its file is read.
    """
    files = sorted(path.glob("*/*/pressuredata.mat"))
    if not files:
        raise ValueError(f"{path}: no [batch]/[recording]/pressuredata.mat in it")
    sessions = sorted({file.parent.parent.name for file in files})
    held = [re.sub(r"^\d+-", "", file.parent.name) for file in files]
    objects = sorted(set(held), key=lambda name: (name != "empty_hand", name))
    shape = _same_shape(files)
    dtype = storage_type(_raw(files[0])[0].dtype, str(files[0]))

    def blocks() -> Iterator[dict[str, np.ndarray]]:
        for number, (file, name) in enumerate(zip(files, held, strict=True)):
            pressure, time, frame = _raw(file)
            if storage_type(pressure.dtype, str(file)) != dtype:
                raise ValueError(f"{file}: pressure is of type {pressure.dtype}; expected {dtype} as in {files[0]}")
            for start in range(0, len(pressure), BLOCK):
                at = slice(start, start + BLOCK)
                count = len(pressure[at])
                yield {
                    "pressure": np.ascontiguousarray(pressure[at]),
                    "time": time[at],
                    "frame": frame[at],
                    "object": np.full(count, objects.index(name)),
                    "recording": np.full(count, number),
                    "session": np.full(count, sessions.index(file.parent.parent.name)),
                }

    names = [f"{file.parent.parent.name}/{file.parent.name}" for file in files]
    return Source(path, objects, names, sessions, shape, dtype, blocks())


def _same_shape(files: list[Path]) -> tuple[int, int]:
    """(H, W) of the frames of all raw recordings; ValueError that lists the files which do not fit."""
    shapes, mistakes = {}, []
    for file in files:
        try:
            shapes[file] = _raw_shape(file)
        except ValueError as error:
            mistakes.append(str(error))
    first = next(iter(shapes), None)
    mistakes += [
        f"{file}: frames of {shape}; expected {shapes[first]} as in {first}"
        for file, shape in shapes.items()
        if shape != shapes[first]
    ]
    refuse(mistakes)
    return shapes[first]


def _raw_shape(path: Path) -> tuple[int, int]:
    """(H, W) of a raw recording whose fields are of the right kinds and lengths, by its headers alone.

    A header does not tell in which type MATLAB stored whole numbers of class double, so types are compared when
    the frames are read.
    """
    from scipy import io

    with _readable(path):
        if h5py.is_hdf5(path):
            with h5py.File(path, "r") as file:
                found = {name: (file[name].shape[::-1], str(file[name].dtype)) for name in RAW if name in file}
        else:
            found = {name: (shape, kind) for name, shape, kind in io.whosmat(str(path))}
    if "pressure" not in found:
        raise ValueError(f"{path}: no field pressure; expected STAG's pressuredata.mat")
    shape, kind = found["pressure"]
    sides = check_shape(shape, str(path))
    if kind in ("char", "cell", "struct", "object", "function", "opaque"):
        raise ValueError(f"{path}: pressure is of type {kind}; expected integer counts or real numbers")
    for name in ("tStamp", "frame"):
        if name in found and (size := math.prod(found[name][0])) != shape[0]:
            raise ValueError(f"{path}: {name} has {size} values; expected one per frame, {shape[0]}")
    return sides


def _raw(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """pressure (N, H, W), seconds since the first frame (N,), frame number (N,) of one raw recording."""
    from scipy import io

    with _readable(path):
        if h5py.is_hdf5(path):
            with h5py.File(path, "r") as file:
                tree = {name: file[name][()].T for name in RAW if name in file}
        else:
            tree = io.loadmat(str(path), variable_names=RAW)
    if "pressure" not in tree:
        raise ValueError(f"{path}: no field pressure; expected STAG's pressuredata.mat")
    pressure = tree["pressure"]
    frames = len(pressure)
    time = _column(tree["tStamp"], "tStamp", frames, path) if "tStamp" in tree else np.full(frames, np.nan)
    frame = _column(tree["frame"], "frame", frames, path) if "frame" in tree else np.arange(frames)
    return pressure, time - (time[0] if frames else 0), frame
