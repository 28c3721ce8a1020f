"""Reading folders of arrays, one file a recording: OBJECT/NAME.npy, .npz or .csv, or SESSION/OBJECT/NAME.npy.

An array is (frames, rows, columns), or (frames, cells) with the cells row after row. With a layout (rows and
columns of a frame) it may also be one frame; without a layout, (frames, cells) are frames of one row.
"""

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from tactile_viewgcn.files import ARRAYS, files_below
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.folder import Names, joined
from tactile_viewgcn.readers.source import MAX_SIDE, UNLABELLED, Source, Values, listed

HEADER = r"\s*(?:[#%]|(?!(?:nan|inf(?:inity)?)\b)[\"']?\s*[^\W\d])"  # a line of names in a .csv begins so
TIME = r"[\s#%\"']*time(?:stamp)?(?![a-z])"  # a line of names begins so where the first column holds times
PLACES = "OBJECT/FILE or SESSION/OBJECT/FILE"


def read_arrays(path: Path, layout: Sequence[int] | None = None, *, labelled: bool = True) -> Source:
    """All files of arrays below a folder; without folders of sessions there is one session.

    Args:
        layout: rows and columns of a frame; None: as the arrays have them.
        labelled: False: files may lie in no object's folder, or be one file; their object is `UNLABELLED`.

    Raises:
        UserError: lists the mistakes of all files, and where they differ in shape or share a name; or some files lie in
            folders of objects and others in folders of sessions.
    """
    root, files = (path if path.is_dir() else path.parent), files_below(path, ARRAYS)
    at_depth = {len(file.relative_to(root).parts): file for file in files}
    if len(at_depth) > 1:
        raise UserError(f"{path}: {' and '.join(map(str, at_depth.values()))}; expected all files as {PLACES}")
    return joined(path, files, partial(_opened, root=root, layout=tuple(layout or ()), labelled=labelled))


@contextmanager
def _opened(file: Path, root: Path, layout: tuple[int, ...], labelled: bool) -> Iterator[tuple[Names, Values]]:
    *folders, _ = (place := file.relative_to(root)).parts
    if len(folders) > 2 or (labelled and not folders):
        raise UserError(f"{root}: {str(place)!r} names no object; expected {PLACES}")
    session, label = ["session", *(folders or [UNLABELLED])][-2:]
    array = _read(file)
    names = {"object": label, "session": session, "recording": place.with_suffix("").as_posix()}
    yield names, {"pressure": array.reshape(_shape(array.shape, layout, file))}


def _shape(shape: tuple[int, ...], layout: tuple[int, ...], file: Path) -> tuple[int, ...]:
    """The shape (T, H, W) of the recording in an array of shape `shape`."""
    if layout and shape == layout:
        return 1, *layout
    if layout and shape in ((*shape[:1], math.prod(layout)), (*shape[:1], *layout)):
        return shape[0], *layout
    if layout:
        expected = f"(frames, {layout[0]}, {layout[1]}) or (frames, {math.prod(layout)})"
        raise UserError(f"{file}: an array {shape}; expected {expected} by --shape, data.shape or the model")
    if len(shape) == 2 and shape[1] > MAX_SIDE:
        raise UserError(f"{file}: an array {shape}; expected a layout by data.shape (inspect --shape ROWS COLUMNS)")
    return (shape[0], 1, shape[1]) if len(shape) == 2 else shape


def _read(file: Path) -> np.ndarray:
    """The array in a file; .npy is memory-mapped. Nothing is unpickled."""
    if file.suffix.lower() == ".csv":
        return _csv(file)
    if file.suffix.lower() == ".npz":
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
            names = [name for name in arrays if len(arrays) == 1 or name == "pressure"]
            if not names:
                raise ValueError(f"arrays: {listed(list(arrays)) or 'none'}; expected one, or pressure among them")
            return arrays[names[0]]
    array = np.load(file, mmap_mode="r", allow_pickle=False)
    if array.offset + array.nbytes != file.stat().st_size:
        raise ValueError("there are more bytes after the array")
    return array


def _csv(file: Path) -> np.ndarray:
    """Numbers (lines, cells), integers where all are, without a first line of names and a first column of times."""
    lines = re.findall(r"\S.*", file.read_text(encoding="utf-8-sig"))  # without blank lines
    words, times = (bool(re.match(pattern, "".join(lines[:1]), re.IGNORECASE)) for pattern in (HEADER, TIME))
    if len(lines) <= words:
        raise ValueError("no line of numbers")
    mark = next((mark for mark in ",;" if mark in lines[words]), None)
    columns = range(1, len(lines[words].split(mark))) if times else None
    read = partial(np.loadtxt, lines[words:], delimiter=mark, comments=None, ndmin=2, usecols=columns)
    try:
        return read(dtype=np.int64)
    except ValueError:
        pass
    try:
        return read(dtype=np.float64)
    except ValueError as error:  # quotes the text, but a link may lead to a file that the user does not mean to show
        raise ValueError(re.sub(r" (['\"]).*\1", "", str(error))) from None
