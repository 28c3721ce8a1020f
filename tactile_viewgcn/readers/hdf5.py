"""Reading the project's own form of recordings, for gloves other than STAG: one HDF5 file a recording.

/pressure     (T, H, W)  integer counts or real numbers, up to 64 x 64
/time         (T,)       seconds, optional
/valid        (T,)       the object is held, optional
/grasp        (T,)       number of the grasp, optional
/grasp_valid  (T,)       frame belongs to the steady part of its grasp, optional
attributes    object, session; optional: recording (else the file's path in the folder), split ("train" or "test")
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import HDF5, files_below, readable_source
from tactile_viewgcn.readers.hdf5_file import AGAIN, DAMAGED, attribute, dataset, open_hdf5
from tactile_viewgcn.readers.source import (
    BLOCK_FRAMES,
    SOURCE_MD5,
    TEST,
    TRAIN,
    UNLABELLED,
    Block,
    Source,
    check_shape,
    listed,
    numbered,
    raise_mistakes,
    storage_type,
)

SPLITS = {"train": TRAIN, "test": TEST}
NOT_LABELLED = {"object": UNLABELLED, "session": "session"}  # attributes that an unlabelled recording may lack
OPTIONAL_COLUMNS = ("time", "valid", "grasp", "grasp_valid")
ATTRIBUTES = ("object", "session", "recording", "split")


@dataclass(frozen=True)
class Header:
    """What one recording's file says of itself; `columns` includes "split" if it names its side."""

    file: Path
    recording: str
    attributes: dict[str, str]
    frames: int
    shape: tuple[int, int]
    dtype: np.dtype
    columns: list[str]


def read_hdf5(path: Path, *, labelled: bool = True) -> Source:
    """One recording, or all .h5 and .hdf5 files below a folder in the order of their paths.

    Args:
        labelled: False: files may lack `object`, which is `UNLABELLED` then, and `session`; those without are of one.

    Raises:
        UserError: lists the mistakes of all files, and where they do not agree in shape, columns or name.
    """
    files = [path] if path.is_file() else files_below(path, HDF5)
    headers: list[Header] = []
    mistakes: list[str] = []
    for file in files:
        try:
            headers.append(_read_header(file, path.parent if path.is_file() else path, labelled))
        except UserError as error:
            mistakes.append(str(error))
    raise_mistakes(mistakes + _disagreements(headers, path))
    objects = numbered([header.attributes["object"] for header in headers])
    sessions = sorted({header.attributes["session"] for header in headers})
    return Source(
        path,
        objects,
        [header.recording for header in headers],
        sessions,
        headers[0].shape,
        storage_type(np.result_type(*(header.dtype for header in headers)), str(path)),
        sum(header.frames for header in headers),
        _blocks(headers, objects, sessions),
    )


def _blocks(headers: list[Header], objects: list[str], sessions: list[str]) -> Iterator[Block]:
    """The frames of all recordings, block by block."""
    for number, header in enumerate(headers):
        attributes = header.attributes
        constant = {
            "object": objects.index(attributes["object"]),
            "recording": number,
            "session": sessions.index(attributes["session"]),
            "time": np.nan,
        }
        if "split" in attributes:
            constant["split"] = SPLITS[attributes["split"]]
        with readable_source(header.file, DAMAGED, AGAIN), open_hdf5(header.file) as file:
            for start in range(0, header.frames, BLOCK_FRAMES):
                at = slice(start, min(start + BLOCK_FRAMES, header.frames))
                block = {name: np.full(at.stop - start, value) for name, value in constant.items()}
                block |= {name: file[name][at] for name in header.columns if name != "split"}
                if "time" in header.columns:
                    begin = float(file["time"][0])  # of integers a difference would wrap
                    block["time"] = block["time"].astype(np.float64) - (0 if np.isinf(begin) else begin)
                yield block | {"pressure": file["pressure"][at], "frame": np.arange(start, at.stop)}


def _disagreements(headers: list[Header], path: Path) -> list[str]:
    """Mistakes of files that are good alone and do not go together."""
    mistakes = [
        f"{header.file}: {what} {getattr(header, what)}; expected {getattr(headers[0], what)} as in {headers[0].file}"
        for header in headers
        for what in ("shape", "columns")
        if getattr(header, what) != getattr(headers[0], what)
    ]
    return mistakes + [
        f"{path}: {'two' if count == 2 else count} recordings are named {name!r}; "
        "expected different names: give each file a `recording` attribute"
        for name, count in Counter(header.recording for header in headers).items()
        if count > 1
    ]


def _read_header(path: Path, root: Path, labelled: bool) -> Header:
    """Header of one file below `root`; a UserError lists all its mistakes."""
    with readable_source(path, DAMAGED, AGAIN), open_hdf5(path) as file:
        if SOURCE_MD5 in file.attrs:
            raise UserError(f"{path}: the table that ingest writes, not a recording; keep it out of the source")
        names = list(file)
        if "pressure" not in names:
            raise UserError(f"{path}: no dataset /pressure; found {listed(names) or 'nothing'}")
        pressure = dataset(file, "pressure")
        shape, dtype = check_shape(pressure.shape, str(path)), storage_type(pressure.dtype, str(path))
        columns, mistakes = [name for name in OPTIONAL_COLUMNS if name in names], []
        for name in columns:
            try:
                values = dataset(file, name)
            except UserError as error:
                mistakes.append(str(error))
                continue
            if values.shape != (len(pressure),):
                mistakes.append(f"{path}: /{name} has shape {values.shape}; expected ({len(pressure)},)")
        attributes = {} if labelled else dict(NOT_LABELLED)
        attributes |= {name: text for name in ATTRIBUTES if (text := attribute(file, name)) is not None}
        mistakes += [
            f"{path}: no attribute {name!r}; expected a text on the file's root"
            for name in ("object", "session")
            if labelled and not attributes.get(name)
        ]
        split = attributes.get("split", "train")
        if split not in SPLITS:
            mistakes.append(f"{path}: attribute split is {split!r}; expected train or test")
        raise_mistakes(mistakes)
        recording = attributes.get("recording", path.relative_to(root).with_suffix("").as_posix())
        columns += ["split"] if "split" in attributes else []
        return Header(path, recording, attributes, len(pressure), shape, dtype, columns)
