"""Reading MAT-files of MATLAB 5 by SciPy, which believes what a file says: how far it inflates is counted before."""

import io
import math
import struct
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.limits import check_size, inflated, most_declared

HEADER = 128  # bytes before the first element
COMPRESSED = 15  # type of an element, miCOMPRESSED
MOST_CELL_BYTES = 2**18  # of an array of names, 3,000 or so; SciPy's recursion into cells of cells ends in a crash


class Element(NamedTuple):
    """An element of the file: where its tag begins, its bytes with the tag, and what they inflate to."""

    start: int
    stored: int
    size: int


def shapes(path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
    """Shape and class of each variable, from the headers alone.

    Raises:
        UserError: a variable declares, or inflates to, far more than is stored, or stands twice.
    """
    from scipy import io as scipy_io

    stored = path.stat().st_size
    check_size(sum(element.size for element in _elements(path)), stored, str(path))
    variables = scipy_io.whosmat(str(path))
    for name, shape, _ in variables:
        check_size(math.prod(shape), stored, f"{path}: {name}")
    names = [name for name, _, _ in variables]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise UserError(f"{path}: {', '.join(twice)} stands twice; expected each variable once")
    return {name: (shape, kind) for name, shape, kind in variables}


def fields(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Those of the named variables that there are: arrays; a cell array as a list of its texts.

    Raises:
        UserError: a cell array that is too large for names. Of a damaged file SciPy raises anything.
    """
    from scipy import io as scipy_io

    variables = scipy_io.whosmat(str(path))
    cells = {name for name, _, kind in variables if kind == "cell" and name in names}
    numbers = [name for name, _, _ in variables if name in names and name not in cells]
    found: dict[str, Any] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of a variable that cannot be read
        if numbers:
            read = scipy_io.loadmat(str(path), variable_names=numbers)
            found = {name: read[name] for name in numbers}
        if cells:
            elements = zip(variables, _elements(path), strict=True)
            found |= {name: _texts(path, name, one) for (name, _, _), one in elements if name in cells}
    return found


def _texts(path: Path, name: str, element: Element) -> list[str]:
    """The texts of a cell array, from its bytes alone: beyond them SciPy would read on."""
    from scipy import io as scipy_io

    if element.size > MOST_CELL_BYTES:
        raise UserError(f"{path}: {name} takes {element.size:,} bytes; expected names in at most {MOST_CELL_BYTES:,}")
    with path.open("rb") as stream:
        header = stream.read(HEADER)
        stream.seek(element.start)
        alone = io.BytesIO(header + stream.read(element.stored))
    return [str(np.squeeze(cell)) for cell in scipy_io.loadmat(alone)[name].ravel()]


def _elements(path: Path) -> list[Element]:
    """The elements of a file in their order; of one of MATLAB 4, where nothing is compressed or nested, none."""
    elements, stored = [], path.stat().st_size
    most = most_declared(stored)
    with path.open("rb") as stream:
        header = stream.read(HEADER)
        if 0 in header[:4]:
            return []
        order = {b"IM": "<", b"MI": ">"}[header[126:128]]
        while len(tag := stream.read(8)) == 8 and most >= 0:
            start = stream.tell() - 8
            kind, count = struct.unpack(f"{order}II", tag)
            if start + 8 + count > stored:
                raise ValueError("an element goes on after the end")
            size = inflated(stream, count, most) if kind == COMPRESSED else count
            elements.append(Element(start, 8 + count, size))
            most -= size
            stream.seek(start + 8 + count)
    return elements
