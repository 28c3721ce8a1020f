"""The project's own recordings: one HDF5 file each, for gloves other than STAG.

/pressure     (T, H, W)  integer counts or real numbers, up to 64 x 64
/time         (T,)       seconds, optional
/valid        (T,)       the object is held, optional
/grasp        (T,)       number of the grasp, optional
/grasp_valid  (T,)       frame belongs to the steady part of its grasp, optional
attributes    object, session; optional: recording (else the file's path in the folder), weight (grams),
              split ("train" or "test")
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from tactile_viewgcn.recordings import BLOCK, EMPTY_HAND, MARK, TEST, TRAIN, Source, check_shape, refuse, storage_type

SPLITS = {"train": TRAIN, "test": TEST}
OPTIONAL = ("time", "valid", "grasp", "grasp_valid")


def read_own(path: Path) -> Source:
    """One recording, or every .h5 and .hdf5 file below a folder in the order of their paths.

    Objects are numbered in the order of their names, the empty hand (`object` = "empty_hand") first.

    Raises:
        ValueError: no recordings, an attribute missing, or files that do not agree in shape, columns or name; the
            sentence lists the mistakes of all files.
    """
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.suffix in (".h5", ".hdf5"))
    if not files:
        raise ValueError(f"{path}: no .h5 or .hdf5 recordings in it")
    root = path.parent if path.is_file() else path
    heads, mistakes = [], []
    for file in files:
        try:
            heads.append(_head(file, root))
        except ValueError as error:
            mistakes.append(str(error))
    refuse(mistakes + _disagreements(heads, path))
    first, names = heads[0], [head["recording"] for head in heads]
    objects = sorted({head["object"] for head in heads}, key=lambda name: (name != EMPTY_HAND, name))
    sessions = sorted({head["session"] for head in heads})
    weights = np.full(len(objects), np.nan)
    for head in heads:
        if head["weight"] is not None:
            weights[objects.index(head["object"])] = head["weight"]

    def blocks() -> Iterator[dict[str, np.ndarray]]:
        for number, head in enumerate(heads):
            with h5py.File(head["file"], "r") as file:
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
                            block[column] = _values(file[column], column, slice(start, start + BLOCK), head["file"])
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


def _disagreements(heads: list[dict], path: Path) -> list[str]:
    """Where files, each good by itself, do not go together: a sentence each."""
    found = [
        f"{head['file']}: {what} {head[what]}; expected {heads[0][what]} as in {heads[0]['file']}"
        for head in heads
        for what in ("shape", "columns")
        if head[what] != heads[0][what]
    ]
    times = Counter(head["recording"] for head in heads)
    return found + [
        f"{path}: {'two' if count == 2 else count} recordings are named {name!r}; "
        "give each its own `recording` attribute"
        for name, count in times.items()
        if count > 1
    ]


def _head(path: Path, root: Path) -> dict:
    """What one file below `root` says of itself; ValueError with all that is wrong with it."""
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise ValueError(f"{path}: not a readable HDF5 file, or cut short ({error})") from None
    with file:
        if MARK in file.attrs:
            raise ValueError(f"{path}: the table that ingest writes, not a recording; keep it out of the source")
        pressure = file.get("pressure")
        if not isinstance(pressure, h5py.Dataset):
            raise ValueError(f"{path}: no dataset /pressure; found {', '.join(file) or 'nothing'}")
        shape, dtype = check_shape(pressure.shape, str(path)), storage_type(pressure.dtype, str(path))
        columns = [name for name in OPTIONAL if name in file]
        attributes = {name: _text(value) for name, value in file.attrs.items()}
        mistakes = _bad_columns(file, columns, len(pressure)) + _bad_attributes(attributes)
        if mistakes:
            raise ValueError("; ".join(f"{path}: {mistake}" for mistake in mistakes))
        split, weight = attributes.get("split"), attributes.get("weight")
        return {
            "file": path,
            "object": attributes["object"],
            "session": attributes["session"],
            "columns": columns if split is None else [*columns, "split"],
            "recording": attributes.get("recording", path.relative_to(root).with_suffix("").as_posix()),
            "weight": None if weight is None else float(weight),
            "split": SPLITS.get(split),
            "frames": len(pressure),
            "shape": shape,
            "dtype": dtype,
        }


def _bad_columns(file: h5py.File, columns: list[str], frames: int) -> list[str]:
    found = []
    for name in columns:
        if not isinstance(file[name], h5py.Dataset):
            found.append(f"/{name} is a group; expected a dataset")
        elif file[name].shape != (frames,):
            found.append(f"/{name} has shape {file[name].shape}; expected ({frames},)")
    return found


def _bad_attributes(attributes: dict[str, str]) -> list[str]:
    found = [
        f"no attribute {name!r}; expected a text on the file's root"
        for name in ("object", "session")
        if not attributes.get(name)
    ]
    weight, split = attributes.get("weight", "0"), attributes.get("split", "train")
    try:
        known = 0 <= float(weight) < np.inf
    except ValueError:
        known = False
    if not known:
        found.append(f"attribute weight is {weight!r}; expected grams")
    if split not in SPLITS:
        found.append(f"attribute split is {split!r}; expected train or test")
    return found


def _text(value: object) -> str:
    """An attribute as text; those of fixed length come as bytes."""
    return value.decode() if isinstance(value, bytes) else str(value)


def _values(dataset: h5py.Dataset, column: str, at: slice, path: Path) -> np.ndarray:
    """Part of an optional column of numbers; seconds count from the first frame."""
    values = dataset[at]
    if values.dtype.kind not in "biuf":
        raise ValueError(f"{path}: /{column} is of type {values.dtype}; expected numbers")
    return values - dataset[0] if column == "time" else values
