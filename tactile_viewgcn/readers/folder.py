"""Joining recordings, one in each file, to one source."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.source import (
    Block,
    Source,
    Values,
    check_shape,
    numbered,
    raise_mistakes,
    sliced,
    storage_type,
)

Names = dict[str, str]  # the names of a recording, its object and its session, by column


@dataclass(frozen=True)
class Header:
    """The description of a recording before its frames are read; `columns` are those besides the pressure (T, H, W)."""

    file: Path
    names: Names
    frames: int
    shape: tuple[int, int]
    dtype: np.dtype
    columns: tuple[str, ...]


def joined(
    path: Path, files: list[Path], opened: Callable[[Path], AbstractContextManager[tuple[Names, Values]]]
) -> Source:
    """The source of recordings in the order of their files, one in memory at a time.

    Args:
        path: the source's path, for its errors.
        opened: opens a file, a context with its names, and its pressure and columns; times may begin at any value.

    Raises:
        UserError: lists the mistakes of all files, and where they differ in shape or columns, or share a name.
    """
    headers: list[Header] = []
    mistakes: list[str] = []
    for file in files:
        try:
            with reading(file), opened(file) as (names, values):
                headers.append(_header(file, names, values))
        except UserError as error:
            mistakes.append(str(error))
    raise_mistakes(mistakes + _disagreements(headers))
    ids = {
        "object": numbered([header.names["object"] for header in headers]),
        "recording": [header.names["recording"] for header in headers],
        "session": sorted({header.names["session"] for header in headers}),
    }

    def blocks() -> Iterator[Block]:
        for number, header in enumerate(headers):
            with reading(header.file), opened(header.file) as (names, values):
                if values["pressure"].shape[0] != header.frames:
                    raise UserError(f"{header.file}: it changed during reading; read it again when it is complete")
                id_of = {name: ids[name].index(names[name]) for name in ("object", "session")} | {"recording": number}
                columns = {name: np.full(header.frames, value) for name, value in id_of.items()}
                if "time" in values and header.frames:
                    time = values["time"][:].astype(np.float64)
                    columns["time"] = time - (0 if np.isinf(time[0]) else time[0])
                yield from sliced({**values, **columns}, header.frames)

    dtype = np.result_type(*{header.dtype for header in headers})
    frames = sum(header.frames for header in headers)
    return Source(path, ids["object"], ids["recording"], ids["session"], headers[0].shape, dtype, frames, blocks())


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
    return Header(file, names, frames, shape, storage_type(values["pressure"].dtype, str(file)), columns)


def _disagreements(headers: list[Header]) -> list[str]:
    """Mistakes of files that differ from most files in shape or columns, or that share a recording's name."""
    mistakes = []
    for what in ("shape", "columns") if headers else ():
        values = [getattr(header, what) for header in headers]
        expected = Counter(values).most_common(1)[0][0]
        like = headers[values.index(expected)].file
        mistakes += [
            f"{header.file}: {what} {value}; expected {expected} as in {like}"
            for header, value in zip(headers, values, strict=True)
            if value != expected
        ]
    first: dict[str, Path] = {}
    for header in headers:
        if (other := first.setdefault(name := header.names["recording"], header.file)) != header.file:
            mistakes.append(
                f"{header.file}: recording {name!r}, as in {other}; expected a name for each: of its file without the "
                "ending, or in HDF5 the attribute `recording`"
            )
    return mistakes
