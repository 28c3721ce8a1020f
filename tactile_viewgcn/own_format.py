"""The project's own recordings: one HDF5 file each, for gloves other than STAG.

/pressure     (T, H, W)  integer counts or real numbers, up to 64 x 64
/time         (T,)       seconds, optional
/valid        (T,)       the object is held, optional
/grasp        (T,)       number of the grasp, optional
/grasp_valid  (T,)       frame belongs to the steady part of its grasp, optional
attributes    object, session; optional: recording (else the file's path in the folder), weight (grams),
              split ("train" or "test")
"""

from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from tactile_viewgcn.recordings import BLOCK, EMPTY_HAND, TEST, TRAIN, Source, check_shape, storage_type

OPTIONAL = ("time", "valid", "grasp", "grasp_valid")


def read_own(path: Path) -> Source:
    """One recording, or every .h5 and .hdf5 file below a folder in the order of their paths.

    Objects are numbered in the order of their names, the empty hand (`object` = "empty_hand") first.

    Raises:
        ValueError: no recordings, an attribute missing, or files that do not agree in shape, columns or name.
    """
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.suffix in (".h5", ".hdf5"))
    if not files:
        raise ValueError(f"{path}: no .h5 or .hdf5 recordings in it")
    root = path.parent if path.is_file() else path
    heads = [_head(file, root) for file in files]
    first = heads[0]
    for file, head in zip(files, heads, strict=True):
        for what in ("shape", "columns"):
            if head[what] != first[what]:
                raise ValueError(f"{file}: {what} {head[what]}; expected {first[what]} as in {files[0]}")
    names = [head["recording"] for head in heads]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{path}: two recordings are named {twice[0]!r}; give each its own `recording` attribute")
    objects = sorted({head["object"] for head in heads}, key=lambda name: (name != EMPTY_HAND, name))
    sessions = sorted({head["session"] for head in heads})
    weights = np.full(len(objects), np.nan)
    for head in heads:
        if head["weight"] is not None:
            weights[objects.index(head["object"])] = head["weight"]

    def blocks() -> Iterator[dict[str, np.ndarray]]:
        for number, (name, head) in enumerate(zip(files, heads, strict=True)):
            with h5py.File(name, "r") as file:
                for start in range(0, head["frames"], BLOCK):
                    pressure = file["pressure"][start : start + BLOCK]
                    count = len(pressure)
                    same = {
                        "object": objects.index(head["object"]),
                        "recording": number,
                        "session": sessions.index(head["session"]),
                    }
                    if head["split"] is not None:
                        same["split"] = head["split"]
                    block = {column: np.full(count, value) for column, value in same.items()}
                    for column in head["columns"]:
                        if column in OPTIONAL:
                            block[column] = _values(file[column], column, slice(start, start + BLOCK), name)
                    block.setdefault("time", np.full(count, np.nan))
                    yield block | {"pressure": pressure, "frame": np.arange(start, start + count)}

    return Source(
        path,
        objects,
        names,
        sessions,
        first["shape"],
        storage_type(np.result_type(*(head["dtype"] for head in heads)), str(path)),
        blocks(),
        weights=None if np.isnan(weights).all() else weights,
    )


def _head(path: Path, root: Path) -> dict:
    """What one file below `root` says of itself, checked."""
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise ValueError(f"{path}: not a readable HDF5 file, or cut short ({error})") from None
    with file:
        if not isinstance(file.get("pressure"), h5py.Dataset):
            raise ValueError(f"{path}: no dataset /pressure; found {', '.join(file) or 'nothing'}")
        for name in ("object", "session"):
            if not _text(file.attrs.get(name, "")):
                raise ValueError(f"{path}: no attribute {name!r}; expected a text on the file's root")
        shape = check_shape(file["pressure"].shape, str(path))
        frames = len(file["pressure"])
        columns = [name for name in OPTIONAL if name in file]
        for name in columns:
            if not isinstance(file[name], h5py.Dataset):
                raise ValueError(f"{path}: /{name} is a group; expected a dataset")
            if file[name].shape != (frames,):
                raise ValueError(f"{path}: /{name} has shape {file[name].shape}; expected ({frames},)")
        attributes = {name: _text(value) for name, value in file.attrs.items()}
        split, weight = attributes.get("split"), attributes.get("weight")
        try:
            weight = None if weight is None else float(weight)
            if weight is not None and not 0 <= weight < np.inf:
                raise ValueError(weight)
        except ValueError:
            raise ValueError(f"{path}: attribute weight is {weight!r}; expected grams") from None
        if split not in (None, "train", "test"):
            raise ValueError(f"{path}: attribute split is {split!r}; expected train or test")
        if split is not None:
            columns.append("split")
        return {
            "object": attributes["object"],
            "session": attributes["session"],
            "columns": columns,
            "recording": attributes.get("recording", path.relative_to(root).with_suffix("").as_posix()),
            "weight": weight,
            "split": {"train": TRAIN, "test": TEST}.get(split),
            "frames": frames,
            "shape": shape,
            "dtype": storage_type(file["pressure"].dtype, str(path)),
        }


def _text(value: object) -> str:
    """An attribute as text; those of fixed length come as bytes."""
    return value.decode() if isinstance(value, bytes) else str(value)


def _values(dataset: h5py.Dataset, column: str, at: slice, path: Path) -> np.ndarray:
    """Part of an optional column of numbers; seconds count from the first frame."""
    values = dataset[at]
    if values.dtype.kind not in "biuf":
        raise ValueError(f"{path}: /{column} is of type {values.dtype}; expected numbers")
    return values - dataset[0] if column == "time" else values
