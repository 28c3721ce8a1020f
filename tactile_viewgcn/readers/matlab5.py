"""Reading MAT-files of MATLAB 5: arrays of numbers, and cell arrays of names.

SciPy reads them too, but crashes where a byte is wrong: it looks up types that a file names without a bound, and goes
down into cells of cells without end. The format: "MAT-File Format", MathWorks, chapter 1.
"""

import math
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.limits import check_size
from tactile_viewgcn.readers.source import MOST_LETTERS, MOST_NAMES

FILE_HEADER = 128  # bytes
HEAD = 1024  # bytes of a variable, in which its header ends: MATLAB's names have 63 letters
MATRIX, COMPRESSED = 14, 15  # types of an element
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
TEXTS = {1: "ascii", 2: "ascii", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
CLASSES = (
    *("unknown", "cell", "struct", "object", "char", "sparse", "double", "single", "int8", "uint8"),
    *("int16", "uint16", "int32", "uint32", "int64", "uint64", "function", "opaque"),
)
COMPLEX = 0x800  # flag


class Variable(NamedTuple):
    """A variable: shape, class, its bytes in the file, and their number when they are inflated."""

    name: str
    shape: tuple[int, ...]
    kind: str
    start: int
    stored: int
    size: int
    compressed: bool


def shapes(path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
    """Shape and class of each variable, from the headers alone.

    Raises:
        UserError: a variable declares far more than is stored, or stands twice. Of a damaged file anything is raised.
    """
    variables: dict[str, tuple[tuple[int, ...], str]] = {}
    for variable in _variables(path, _order(path)):
        if variable.name in variables:
            raise UserError(f"{path}: {variable.name} stands twice; expected each variable once")
        variables[variable.name] = variable.shape, variable.kind
    return variables


def fields(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Those of the named variables that there are: arrays; a cell array as a list of its texts."""
    order, values = _order(path), {}
    for variable in _variables(path, order):
        if variable.name in names:
            with path.open("rb") as stream:
                stream.seek(variable.start)
                content = stream.read(variable.stored)
            if variable.compressed:
                content = zlib.decompressobj().decompress(content, variable.size)
            if len(content) != variable.size:
                raise ValueError(f"{variable.name} is cut short")
            values[variable.name] = _value(memoryview(content)[8:], order)
    return values


def _order(path: Path) -> str:
    """The order of bytes, as `struct` names it."""
    with path.open("rb") as stream:
        mark = stream.read(FILE_HEADER)[126:]
    if mark not in (b"IM", b"MI"):
        raise ValueError("it does not begin as one of MATLAB 5")
    return "<" if mark == b"IM" else ">"


def _variables(path: Path, order: str) -> Iterator[Variable]:
    """The variables of a file, by their headers."""
    end = path.stat().st_size
    with path.open("rb") as stream:
        start = FILE_HEADER
        while start < end:
            stream.seek(start)
            kind, count = struct.unpack(f"{order}II", stream.read(8))
            if start + 8 + count > end:
                raise ValueError("a variable goes on after the end")
            head = stream.read(min(count, HEAD))
            if kind == COMPRESSED:
                head = zlib.decompressobj().decompress(head, HEAD)
                inner, size = struct.unpack_from(f"{order}II", head)
                place = start + 8, count, 8 + size, True
            else:
                inner, head, place = kind, bytes(8) + head, (start, 8 + count, 8 + count, False)
            if inner != MATRIX:
                raise ValueError(f"an element of type {inner} is no variable")
            name, shape, kind_name, _ = _header(memoryview(head)[8:], order)
            check_size(max(place[2], math.prod(shape)), end, f"{path}: {name}")
            yield Variable(name, shape, kind_name, *place)
            start += 8 + count


def _header(data: memoryview, order: str) -> tuple[str, tuple[int, ...], str, int]:
    """Name, shape and class of a matrix, and where its content begins."""
    _, flags, at = _part(data, 0, order)
    (word,) = struct.unpack_from(f"{order}I", flags)
    kind = CLASSES[word & 0xFF]
    if kind == "opaque":  # it has no shape
        return bytes(_part(data, at, order)[1]).decode("latin-1"), (), kind, at
    _, sides, at = _part(data, at, order)
    _, name, at = _part(data, at, order)
    shape = struct.unpack(f"{order}{len(sides) // 4}I", sides)
    return bytes(name).decode("latin-1"), shape, "complex" if word & COMPLEX else kind, at


def _part(data: memoryview, at: int, order: str) -> tuple[int, memoryview, int]:
    """Type and content of the part of a matrix that begins there, and where the next one does."""
    kind, count = struct.unpack_from(f"{order}II", data, at)
    if kind >> 16:  # up to four bytes, within the tag
        kind, count, begin, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
    else:
        begin, after = at + 8, at + 8 + count + -count % 8
    if begin + count > len(data) or begin + count > after:
        raise ValueError("a part of a variable goes on after its end")
    return kind, data[begin : begin + count], after


def _value(data: memoryview, order: str) -> Any:
    """The array of a matrix of numbers, or the texts of a cell array."""
    _, shape, kind, at = _header(data, order)
    if kind == "cell":
        texts = []
        for _ in range(min(math.prod(shape), MOST_NAMES + 1)):
            _, cell, at = _part(data, at, order)
            texts.append(_text(cell, order))
        return texts
    code, content, _ = _part(data, at, order)
    dtype = np.dtype(order + NUMBERS[code])
    return np.frombuffer(content, dtype).reshape(shape, order="F").astype(dtype.newbyteorder("="), copy=False)


def _text(data: memoryview, order: str) -> str:
    """The text of a matrix of letters."""
    _, _, kind, at = _header(data, order)
    if kind != "char":
        raise ValueError(f"a cell is of type {kind}, and no text")
    code, letters, _ = _part(data, at, order)
    codec = TEXTS[code] + ("" if TEXTS[code] in ("ascii", "utf-8") else "-le" if order == "<" else "-be")
    return bytes(letters[: 4 * MOST_LETTERS + 4]).decode(codec)
