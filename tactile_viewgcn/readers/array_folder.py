"""Reading folders of arrays, one file a recording: OBJECT/NAME.npy, .npz or .csv, or SESSION/OBJECT/NAME.npy.

A file holds (frames, rows, columns) or (frames, cells): of a given layout, else of one row. With a layout, also one
frame (rows, columns).
"""

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import ARRAYS, check_is_file, files_below, readable_source
from tactile_viewgcn.readers.source import (
    BLOCK_FRAMES,
    MAX_SIDE,
    UNLABELLED,
    Block,
    Source,
    check_shape,
    listed,
    numbered,
    raise_mistakes,
    storage_type,
)  # fmt: skip

MOST_LINE = 2**17  # letters of a line: 32 for each of 64 x 64 sensors
HEADER = r"\s*(?:[#%]|(?!(?:nan|inf(?:inity)?)\b)[\"']?\s*[^\W\d])"  # how a line of .csv begins that is none of numbers
TIME = r"[\s#%\"']*time(?:stamp)?(?![a-z])"  # how the names of a .csv begin whose first column is no sensor
PLACES = "OBJECT/FILE or SESSION/OBJECT/FILE"


@dataclass(frozen=True)
class Header:
    """What is known of one recording before its frames are read; `shape` is (T, H, W), `dtype` as it is stored."""

    file: Path
    recording: str
    object: str
    session: str
    shape: tuple[int, int, int]
    dtype: np.dtype


def read_arrays(path: Path, layout: Sequence[int] | None = None, *, labelled: bool = True) -> Source:
    """All files of arrays below a folder. Without folders of sessions they are of one.

    Args:
        layout: rows and columns of a frame; None: as the arrays have them.
        labelled: False: files may lie in no object's folder, or be one file; their object is `UNLABELLED`.

    Raises:
        UserError: lists the mistakes of all files, and where they do not agree in shape, place or name.
    """
    headers: list[Header] = []
    mistakes: list[str] = []
    for file in files_below(path, ARRAYS):
        try:
            headers.append(_read_header(file, path if path.is_dir() else path.parent, tuple(layout or ()), labelled))
        except UserError as error:
            mistakes.append(str(error))
    raise_mistakes(mistakes + _disagreements(headers))
    objects, sessions = numbered([header.object for header in headers]), sorted({header.session for header in headers})

    def blocks() -> Iterator[Block]:
        for number, header in enumerate(headers):
            frames, ids = _read(header.file).reshape(header.shape), {"recording": number, "time": np.nan}
            ids |= {"object": objects.index(header.object), "session": sessions.index(header.session)}
            for start in range(0, len(frames), BLOCK_FRAMES):
                pressure = np.ascontiguousarray(frames[start : start + BLOCK_FRAMES])
                block = {name: np.full(len(pressure), value) for name, value in ids.items()}
                yield block | {"pressure": pressure, "frame": start + np.arange(len(pressure))}

    names, frames = [header.recording for header in headers], sum(header.shape[0] for header in headers)
    dtype = np.result_type(*{header.dtype for header in headers})
    return Source(path, objects, names, sessions, headers[0].shape[1:], dtype, frames, blocks())


def _disagreements(headers: list[Header]) -> list[str]:
    """Mistakes of files that are good alone and do not go together; what most files have is expected."""
    if not headers:
        return []
    mistakes, count = [], Counter(header.recording for header in headers)
    sides = [f"{header.shape[1]} x {header.shape[2]}" for header in headers]
    depths = [header.recording.count("/") for header in headers]
    expected = Counter(sides).most_common(1)[0][0]
    depth = Counter(depths).most_common(1)[0][0]
    for header, side, deep in zip(headers, sides, depths, strict=True):
        if side != expected:
            file = headers[sides.index(expected)].file
            mistakes.append(f"{header.file}: frames of {side}; expected {expected} as in {file}")
        if deep != depth:
            file = headers[depths.index(depth)].file
            mistakes.append(f"{header.file}: other folders than {file}; expected all files as {PLACES}")
        if count[header.recording] > 1:
            mistakes.append(f"{header.file}: another file differs in its ending alone; expected one for each recording")
    return mistakes


def _read_header(file: Path, root: Path, layout: tuple[int, ...], labelled: bool) -> Header:
    *folders, _ = (place := file.relative_to(root)).parts
    if len(folders) > 2 or (labelled and not folders):
        raise UserError(f"{root}: {str(place)!r} names no object; expected {PLACES}")
    session, label = ["session", *(folders or [UNLABELLED])][-2:]
    array, name = _read(file), place.with_suffix("").as_posix()
    return Header(file, name, label, session, _frames(array.shape, layout, file), storage_type(array.dtype, str(file)))


def _frames(shape: tuple[int, ...], layout: tuple[int, ...], file: Path) -> tuple[int, int, int]:
    """(T, H, W) of an array of that shape."""
    if not shape:
        raise UserError(f"{file}: an array {shape}; expected (frames, rows, columns) or (frames, cells)")
    if layout and shape in (layout, (*shape[:1], math.prod(layout)), (*shape[:1], *layout)):
        return 1 if shape == layout else shape[0], layout[0], layout[1]
    if layout:
        expected = f"(frames, {layout[0]}, {layout[1]}) or (frames, {math.prod(layout)})"
        raise UserError(f"{file}: an array {shape}; expected {expected} by --shape, data.shape or the model")
    if len(shape) == 2 and shape[1] > MAX_SIDE:
        raise UserError(f"{file}: an array {shape}; expected a layout by data.shape (inspect --shape ROWS COLUMNS)")
    return shape[0], *check_shape((shape[0], 1, shape[1]) if len(shape) == 2 else shape, str(file))


def _read(file: Path) -> np.ndarray:
    """The array in a file, of .npy mapped. Nothing is unpickled, and what a header declares has to be in the file."""
    check_is_file(file)
    with readable_source(file, f"not readable as {file.suffix}, or cut short", "save it again"):
        if file.suffix.lower() == ".csv":
            return _csv(file)
        if file.suffix.lower() == ".npz":
            return _npz(file)
        array = np.load(file, mmap_mode="r", allow_pickle=False)
        if array.offset + array.nbytes != file.stat().st_size:
            raise ValueError("it goes on after its first array")
        return array


def _npz(file: Path) -> np.ndarray:
    """The only array of a file, or the one named pressure."""
    with file.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
        names = [name for name in arrays if len(arrays) == 1 or name == "pressure"]
        if not names:
            raise ValueError(f"arrays: {listed(list(arrays)) or 'none'}; expected one, or pressure among them")
        if isinstance(array := arrays[names[0]], np.ndarray):
            return array
    raise ValueError(f"{names[0]} is no array")


def _csv(file: Path) -> np.ndarray:
    """Numbers (lines, cells), whole ones where all are; a first line of names is left out, and a column of times."""
    header = next(_lines(file), "")
    words, times = (bool(re.match(pattern, header, re.IGNORECASE)) for pattern in (HEADER, TIME))
    first = next(islice(_lines(file), words, None), "")
    if not first:
        raise ValueError("no line of numbers")
    mark = next((mark for mark in ",;" if mark in first), None)
    columns = range(1, len(first.split(mark))) if times else None
    for kind in (np.int64, np.float64):
        try:
            lines = islice(_lines(file), words, None)
            return np.loadtxt(lines, kind, delimiter=mark, comments=None, ndmin=2, usecols=columns)
        except ValueError as error:
            reason = str(error).partition("; use")[0]  # what follows is of NumPy's options
    raise ValueError(reason)


def _lines(file: Path) -> Iterator[str]:
    """The lines of a text that are not blank, one at a time."""
    with file.open(encoding="utf-8-sig") as stream:
        while line := stream.readline(MOST_LINE + 1):
            if len(line) > MOST_LINE:
                raise ValueError(f"a line of more than {MOST_LINE:,} letters")
            if line.strip():
                yield line
