"""Joining recordings, one in each file, to one source."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.source import (
    UNLABELLED,
    Block,
    Source,
    Values,
    check_shape,
    listed,
    numbered,
    raise_mistakes,
    sliced,
    storage_type,
)

MANY = 10  # good files beside which one of a different kind is left out
Names = dict[str, str]  # the names of a recording, its object and its session, by column
UNNAMED = {"object": UNLABELLED, "session": "session"}  # of a recording that names none


@dataclass(frozen=True)
class Header:
    """The description of a recording before its frames are read.

    Attributes:
        frames: number of all frames, and `kept` without those that `_kept` drops.
        columns: those besides the pressure (T, H, W).
    """

    file: Path
    names: Names
    frames: int
    kept: int
    shape: tuple[int, int]
    dtype: np.dtype
    columns: tuple[str, ...]


def joined(
    path: Path, files: list[Path], opened: Callable[[Path], AbstractContextManager[tuple[Names, Values]]]
) -> Source:
    """The source of recordings in the order of their files, one in memory at a time.

    Files that cannot be read or differ in shape or columns are left out where there are ten times as many others.

    Args:
        path: the source's path, for its errors.
        opened: opens a file, a context with its names, and its pressure and columns; times may begin at any value, and
            names may lack those of object and session.

    Raises:
        UserError: lists the mistakes of all files, and where they differ in shape or columns, or share a name.
    """
    headers, strays, notes = list[Header](), dict[Path, str](), list[Note]()
    for file in files:
        try:
            with reading(file), opened(file) as (names, values):
                headers.append(_header(file, UNNAMED | names, values))
        except UserError as error:
            strays[file] = str(error)
    strays |= _unlike(headers)
    if are_few := len(strays) * MANY <= len(headers):
        headers = [header for header in headers if header.file not in strays]
    raise_mistakes([*dict.fromkeys(strays.values())] * (not are_few) + _of_one_name(headers))
    if strays:
        text = f"{several(len(strays), 'file')} left out beside {len(headers):,}: "
        notes.append(Note(text + listed(list(strays.values()), "; "), "warning", "files"))
    if dropped := sum(header.frames - header.kept for header in headers):
        text = f"{several(dropped, 'frame')} without readings, in which nothing is held, are left out"
        notes.append(Note(text, topic="frames"))
    ids = {
        "object": numbered([header.names["object"] for header in headers]),
        "recording": [header.names["recording"] for header in headers],
        "session": sorted({header.names["session"] for header in headers}),
    }

    def blocks() -> Iterator[Block]:
        for number, header in enumerate(headers):
            with reading(header.file), opened(header.file) as (_, values):
                if values["pressure"].shape[0] != header.frames:
                    raise UserError(f"{header.file}: it changed during reading; read it again when it is complete")
                id_of = {name: ids[name].index(header.names[name]) for name in UNNAMED} | {"recording": number}
                columns = {name: np.full(header.frames, value) for name, value in id_of.items()}
                if "time" in values and header.frames:
                    time = values["time"][:].astype(np.float64)
                    columns["time"] = time - (0 if np.isinf(time[0]) else time[0])
                yield from _kept({**values, **columns}, header.frames)

    dtype = np.result_type(*{header.dtype for header in headers})
    frames, shape = sum(header.kept for header in headers), headers[0].shape
    return Source(path, ids, shape, dtype, frames, blocks(), notes)


def _kept(values: Values, frames: int) -> Iterator[Block]:
    """The frames in blocks, without those that read NaN and in which `valid` says that nothing is held."""
    for block in sliced(values, frames):
        if "valid" in block and block["pressure"].dtype.kind == "f":
            kept = (block["valid"] != 0) | ~np.isnan(block["pressure"]).any(axis=(1, 2))
            block = {name: column[kept] for name, column in block.items()}
        yield block


def _header(file: Path, names: Names, values: Values) -> Header:
    shape, frames = check_shape(values["pressure"].shape, str(file)), values["pressure"].shape[0]
    columns = tuple(name for name in values if name != "pressure")
    raise_mistakes(
        [
            f"{file}: {name} has shape {values[name].shape}; expected ({frames},), a value for each frame"
            for name in columns
            if values[name].shape != (frames,)
        ]
    )
    dtype, kept = storage_type(values["pressure"].dtype, str(file)), frames
    if "valid" in columns and dtype.kind == "f":
        kept = sum(len(block["pressure"]) for block in _kept(values, frames))
    return Header(file, names, frames, kept, shape, dtype, columns)


def _unlike(headers: list[Header]) -> dict[Path, str]:
    """Mistakes, by file, of files that differ from most files in shape or columns."""
    mistakes: dict[Path, str] = {}
    for what in ("shape", "columns") if headers else ():
        values = [getattr(header, what) for header in headers]
        expected = Counter(values).most_common(1)[0][0]
        like = headers[values.index(expected)].file
        for header, value in zip(headers, values, strict=True):
            if value != expected:
                mistakes.setdefault(header.file, f"{header.file}: {what} {value}; expected {expected} as in {like}")
    return mistakes


def _of_one_name(headers: list[Header]) -> list[str]:
    """Mistakes of files that share a recording's name."""
    mistakes, first = [], dict[str, Path]()
    for header in headers:
        if (other := first.setdefault(name := header.names["recording"], header.file)) != header.file:
            mistakes.append(
                f"{header.file}: recording {name!r}, as in {other}; expected a name for each: of its file without the "
                "ending, or in HDF5 the attribute `recording`"
            )
    return mistakes
