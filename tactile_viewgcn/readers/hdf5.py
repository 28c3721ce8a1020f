"""Reading the project's own form of recordings, for gloves other than STAG: one HDF5 file a recording.

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
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.source import (
    BLOCK_FRAMES,
    EMPTY_HAND,
    TEST,
    TRAIN,
    UNLABELLED,
    Block,
    Source,
    check_shape,
    mistakes_in_frames,
    raise_mistakes,
    storage_type,
)
from tactile_viewgcn.tables.recordings import SOURCE_MD5

SUFFIXES = (".h5", ".hdf5")
SPLITS = {"train": TRAIN, "test": TEST}
NOT_LABELLED = {"object": UNLABELLED, "session": "session"}  # attributes that an unlabelled recording may lack
OPTIONAL_COLUMNS = ("time", "valid", "grasp", "grasp_valid")


@dataclass(frozen=True)
class Header:
    """Attributes and form of one recording's file; `columns` includes "split" if the file names its side."""

    file: Path
    object: str
    session: str
    recording: str
    weight: float | None
    split: int | None
    frames: int
    shape: tuple[int, int]
    dtype: np.dtype
    columns: list[str]


def read_hdf5(path: Path, *, labelled: bool = True) -> Source:
    """One recording, or all .h5 and .hdf5 files below a folder in the order of their paths.

    Objects are numbered in the order of their names, the empty hand (`object` = "empty_hand") first.

    Args:
        labelled: False: files may lack `object`, which is `UNLABELLED` then, and `session`; those without are of one.

    Raises:
        UserError: no recordings, an attribute missing, or files that do not agree in shape, columns or name; the
            message lists the mistakes of all files.
    """
    files = [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.suffix in SUFFIXES)
    if not files:
        raise UserError(f"{path}: no .h5 or .hdf5 recordings in it")
    root = path.parent if path.is_file() else path
    headers: list[Header] = []
    mistakes: list[str] = []
    for file in files:
        try:
            headers.append(_read_header(file, root, labelled))
        except UserError as error:
            mistakes.append(str(error))
    if mistakes := mistakes + _disagreements(headers, path):
        alike = [
            header for header in headers if (header.shape, header.columns) == (headers[0].shape, headers[0].columns)
        ]
        raise_mistakes(mistakes + (mistakes_in_frames(_source(alike, path)) if alike else []))
    return _source(headers, path)


def _source(headers: list[Header], path: Path) -> Source:
    """The source of recordings that go together."""
    objects = sorted({header.object for header in headers}, key=lambda name: (name != EMPTY_HAND, name))
    sessions = sorted({header.session for header in headers})
    weights = np.full(len(objects), np.nan)
    for header in headers:
        if header.weight is not None:
            weights[objects.index(header.object)] = header.weight
    return Source(
        path,
        objects,
        [header.recording for header in headers],
        sessions,
        headers[0].shape,
        storage_type(np.result_type(*(header.dtype for header in headers)), str(path)),
        _blocks(headers, objects, sessions),
        weights=None if np.isnan(weights).all() else weights,
    )


def _blocks(headers: list[Header], objects: list[str], sessions: list[str]) -> Iterator[Block]:
    """The frames of all recordings, block by block."""
    for number, header in enumerate(headers):
        constant = {
            "object": objects.index(header.object),
            "recording": number,
            "session": sessions.index(header.session),
        }
        if header.split is not None:
            constant["split"] = header.split
        with h5py.File(header.file, "r") as file:
            for start in range(0, header.frames, BLOCK_FRAMES):
                at = slice(start, start + BLOCK_FRAMES)
                pressure = file["pressure"][at]
                count = len(pressure)
                block = {column: np.full(count, value) for column, value in constant.items()}
                for column in header.columns:
                    if column in OPTIONAL_COLUMNS:
                        block[column] = _column(file[column], column, at, header.file)
                block.setdefault("time", np.full(count, np.nan))
                yield block | {"pressure": pressure, "frame": np.arange(start, start + count)}


def _disagreements(headers: list[Header], path: Path) -> list[str]:
    """Mistakes of files that are good alone and do not go together."""
    first = headers[0] if headers else None
    mistakes = [
        f"{header.file}: {what} {getattr(header, what)}; expected {getattr(first, what)} as in {first.file}"
        for header in headers
        for what in ("shape", "columns")
        if first and getattr(header, what) != getattr(first, what)
    ]
    counts = Counter(header.recording for header in headers)
    return mistakes + [
        f"{path}: {'two' if count == 2 else count} recordings are named {name!r}; "
        "expected different names: give each file a `recording` attribute"
        for name, count in counts.items()
        if count > 1
    ]


def _read_header(path: Path, root: Path, labelled: bool) -> Header:
    """Header of one file below `root`.

    Raises:
        UserError: lists all mistakes of the file.
    """
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise UserError(
            f"{path}: not a readable HDF5 file, or cut short ({error}); record or download it again"
        ) from None
    with file:
        if SOURCE_MD5 in file.attrs:
            raise UserError(f"{path}: the table that ingest writes, not a recording; keep it out of the source")
        pressure = file.get("pressure")
        if not isinstance(pressure, h5py.Dataset):
            raise UserError(f"{path}: no dataset /pressure; found {', '.join(file) or 'nothing'}")
        shape, dtype = check_shape(pressure.shape, str(path)), storage_type(pressure.dtype, str(path))
        columns = [name for name in OPTIONAL_COLUMNS if name in file]
        attributes = {} if labelled else dict(NOT_LABELLED)
        attributes |= {name: _text(value) for name, value in file.attrs.items()}
        mistakes = _column_mistakes(file, columns, len(pressure)) + _attribute_mistakes(attributes, labelled)
        if mistakes:
            raise UserError("; ".join(f"{path}: {mistake}" for mistake in mistakes))
        split = attributes.get("split")
        return Header(
            file=path,
            object=attributes["object"],
            session=attributes["session"],
            recording=attributes.get("recording", path.relative_to(root).with_suffix("").as_posix()),
            weight=float(attributes["weight"]) if "weight" in attributes else None,
            split=None if split is None else SPLITS[split],
            frames=len(pressure),
            shape=shape,
            dtype=dtype,
            columns=columns if split is None else [*columns, "split"],
        )


def _column_mistakes(file: h5py.File, columns: list[str], frames: int) -> list[str]:
    """Optional columns that are no dataset of one value per frame."""
    mistakes = []
    for name in columns:
        if not isinstance(file[name], h5py.Dataset):
            mistakes.append(f"/{name} is a group; expected a dataset")
        elif file[name].shape != (frames,):
            mistakes.append(f"/{name} has shape {file[name].shape}; expected ({frames},)")
    return mistakes


def _attribute_mistakes(attributes: dict[str, str], labelled: bool) -> list[str]:
    """Attributes that are missing or not among the allowed values."""
    mistakes = [
        f"no attribute {name!r}; expected a text on the file's root"
        for name in ("object", "session")
        if labelled and not attributes.get(name)
    ]
    weight, split = attributes.get("weight", "0"), attributes.get("split", "train")
    try:
        in_grams = 0 <= float(weight) < np.inf
    except ValueError:
        in_grams = False
    if not in_grams:
        mistakes.append(f"attribute weight is {weight!r}; expected grams")
    if split not in SPLITS:
        mistakes.append(f"attribute split is {split!r}; expected train or test")
    return mistakes


def _text(value: object) -> str:
    """An attribute as text; HDF5 gives one of fixed length as bytes."""
    return value.decode() if isinstance(value, bytes) else str(value)


def _column(dataset: h5py.Dataset, name: str, at: slice, path: Path) -> np.ndarray:
    """Part of an optional column of numbers; seconds are counted from the first frame."""
    values = dataset[at]
    if values.dtype.kind not in "biuf":
        raise UserError(f"{path}: /{name} is of type {values.dtype}; expected numbers")
    return values - dataset[0] if name == "time" else values
