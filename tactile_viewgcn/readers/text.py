"""Read tables of numbers from text: a line for each frame, a column for each sensor.

Commas, semicolons, tabs or blanks separate the cells. A number has a decimal point or a decimal
comma. Lines above the numbers can hold words; the first of these lines with a cell for each column
names the columns. Lines that begin with # or % hold no numbers.
"""

import csv
import gzip
import io
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from tactile_viewgcn.messages import Note, UserError, listed, several
from tactile_viewgcn.readers.child import check_unpacked, library
from tactile_viewgcn.readers.lines import COLUMN_NUMBERS
from tactile_viewgcn.readers.numerals import GROUPED_BY_BLANKS, check_numerals
from tactile_viewgcn.readers.serial import check_is_table
from tactile_viewgcn.readers.source import Form, Recording
from tactile_viewgcn.readers.table_columns import table_of

if TYPE_CHECKING:
    from pandas import DataFrame, Index, Series

TOP_LINES = 200  # lines that are searched for the separator and the names
COMMENT = ("#", "%")
NUMBER = re.compile(r"(?i)[-+]?(\d+([.,]\d*)?|[.,]\d+)(e[-+]?\d+)?|[-+]?(nan|inf|infinity)")
# a comment, or a line of empty cells
NOT_NUMBERS = re.compile(r"^[ \t]*[#%].*$|^[ \t,;]+$", re.MULTILINE)
BEGINS_OF_NUMBERS = re.compile(r"(?<![\w.])[-+]?\d")
FEWEST_COUNTED = 3  # columns that a line of their numbers names
PIECE = 1 << 20  # bytes that are unpacked at once
GZIP = b"\x1f\x8b"  # the first bytes of a file that gzip packed
UTF16 = (b"\xff\xfe", b"\xfe\xff")  # the first bytes of a text in UTF-16


def read_text(file: Path) -> str:
    """Return the text of a file, which can be packed by gzip; every line ends in a newline.

    Raises:
        UserError: the file unpacks to more than is allowed for its size. Or it holds the character
            NUL, as UTF-16 without a byte order mark does.
    """
    with file.open("rb") as stream:
        if stream.peek(len(GZIP)).startswith(GZIP):
            data = _unpacked(file, stream)
        else:
            data = stream.read()
    try:
        text = data.decode("utf-16" if data.startswith(UTF16) else "utf-8-sig")
    except UnicodeDecodeError:
        # spreadsheets in western languages save this; it writes digits as UTF-8 does
        text = data.decode("latin-1")
    if "\0" in text:
        raise UserError(f"{file}: this is no text; save a table of numbers in UTF-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _unpacked(file: Path, stream: BinaryIO) -> bytes:
    """Return the unpacked bytes of a file that gzip packed.

    They are read in pieces, since one call would hold all of them twice.

    Raises:
        UserError: there are too many, see `read_text`.
    """
    data = io.BytesIO()
    with gzip.open(stream) as packed:
        while True:
            with library(file):
                piece = packed.read(PIECE)
            if not piece:
                return data.getvalue()
            data.write(piece)
            check_unpacked(file, data.tell())


def table_in(file: Path, text: str, form: Form) -> Recording:
    """Return the table in a text as one recording, with the labels of its lines, see `table_of`.

    A line of units below the names is left out, and a note says so. Such a line holds words. It can
    also hold only ones, if no other cell of the table is 1.

    Args:
        file: the file of the text, which errors name.
        text: the text, see `read_text`.
        form: what the user says about the columns.

    Raises:
        UserError: there are no numbers, the lines differ in length, or a number has two readings.
            `table_of` raises it too.
    """
    check_is_table(file, text)
    top = _top(file, text)
    numbers = NOT_NUMBERS.sub("", text)
    check_numerals(file, numbers, top.separator, top.above)
    has_decimal_commas = top.separator != "," and bool(re.search(r"\d,\d", text))
    decimal = "," if has_decimal_commas else "."
    cells = _read(file, numbers, top, decimal=decimal, float_precision="round_trip")
    places = _places(numbers, top.above)
    width = 1 + int(max(np.flatnonzero(cells.notna().any()), default=-1))
    full = [row[:width] for row in top.rows if len(row) >= width and not any(row[width:])]
    # the last columns have names, and are empty
    if not full and top.rows and width < len(top.rows[-1]) <= cells.shape[1]:
        full = top.rows[-1:]
        width = len(top.rows[-1])
    first = split_line(next(islice(io.StringIO(text), top.above, None)), top.separator)
    if full and _are_ones(first, cells, width):
        full.append(first)
        cells = cells.iloc[1:]
        next(places)
    notes = [
        Note(f"the line {listed(row)} below the names holds units and is no frame", topic="units")
        for row in full[1:]
    ]
    if top.is_numbered:
        notes.append(Note(COLUMN_NUMBERS, topic="columns"))
    names = full[0] if full else [""] * width
    units = full[-1] if len(full) > 1 else []
    texts_of = partial(_texts_of, file, numbers, top, cells.index, decimal)
    table, labels = table_of(names, cells, form, str(file), places, units=units, texts_of=texts_of)
    return replace(table, notes=notes + table.notes, labels=labels)


def _texts_of(
    file: Path, numbers: str, top: "_Top", rows: "Index", decimal: str, column: int
) -> "Series":
    """Return the cells of a column as they are written, with decimal points.

    Args:
        file: the file, which errors name.
        numbers: a text without its comments.
        top: the top of the text.
        rows: numbers of the rows that are returned.
        decimal: the mark of decimals in the text.
        column: number of the column.
    """
    cells: Series = _read(file, numbers, top, usecols=[column], dtype=str)[column]
    if decimal == ",":
        cells = cells.str.replace(r"^([-+]?\d+),(\d*)$", r"\1.\2", regex=True)
    return cells.loc[rows]


def _read(file: Path, numbers: str, top: "_Top", **options: Any) -> "DataFrame":
    """Return cells below the top of a text.

    Args:
        file: the file, which errors name.
        numbers: the text without its comments.
        top: the top of the text.
        **options: of `pandas.read_csv`.
    """
    import pandas as pd  # here, since it loads slowly

    with (
        warnings.catch_warnings(),
        # Arrow's texts need more memory than the child process is allowed
        pd.option_context("mode.string_storage", "python"),
        library(file),
    ):
        # pandas 3.1 warns of float_precision, since it rounds in this way by default
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            return pd.read_csv(
                io.StringIO(numbers),
                sep=top.separator or r"\s+",
                header=None,
                skiprows=top.above,
                keep_default_na=False,
                na_values=[""],
                skipinitialspace=True,
                low_memory=False,
                **options,
            )
        except pd.errors.ParserError as error:  # such as `Expected 2 fields in line 3, saw 4`
            what = str(error).rpartition("error: ")[2].strip()
            raise UserError(f"{file}: {what}; correct or delete the line") from None


def _are_ones(first: list[str], cells: "DataFrame", width: int) -> bool:
    """Return whether the first line gives units as ones: all its cells are 1, and no others are."""
    if width < 2 or first.count("1") != width or len(cells) < 3:
        return False
    return bool((cells.iloc[:, :width] == 1).sum().eq(1).all())


def _places(text: str, above: int) -> Iterator[str]:
    """Yield `line N` for each row of a table; an editor counts the lines in the same way.

    Args:
        text: the text of the table.
        above: the number of lines above the rows.
    """
    # a copy of the text takes memory, so it is made only when an error names a line
    for number, line in enumerate(io.StringIO(text), 1):
        if number > above and line != "\n":
            yield f"line {number}"


@dataclass(frozen=True)
class _Top:
    """The top of a table.

    Attributes:
        separator: the separator of the cells; None for blanks.
        above: the number of lines above the numbers.
        rows: the cells of these lines.
        is_numbered: whether the first of these lines numbers the columns.
    """

    separator: str | None
    above: int
    rows: list[list[str]]
    is_numbered: bool = False


def _top(file: Path, text: str) -> _Top:
    """Return the separator of a table, and the lines above its numbers.

    A line above the numbers is a comment. Or it begins with a word, and has words where the lines
    below have numbers. Or it is the first line, and numbers the columns.

    If logging began in the middle of a line, the first line of the file is cut. This is checked
    only where nothing stands above the first line of numbers, not even a comment.

    Raises:
        UserError: there is no line of numbers, or the first line of the file is cut.
    """
    top = list[tuple[int, str]]()
    for number, line in enumerate(islice(io.StringIO(text), TOP_LINES)):
        if line.strip(" \t\n,;"):
            top.append((number, line))
    below = [line for _, line in top if not _is_comment(line)][-3:]
    sample = max(below, key=lambda line: len(BEGINS_OF_NUMBERS.findall(line)), default="")
    separator = separator_of(sample.strip())
    example = split_line(sample, separator)
    if len(below) == 1 and all(cell[:1].isalpha() for cell in example):  # only names of columns
        raise _without_numbers(file)
    rows = list[list[str]]()
    is_numbered = False
    for number, line in top:
        cells = split_line(line.lstrip("".join(COMMENT) + " "), separator)
        if _is_comment(line):
            rows.append(cells)
            continue
        if not rows:
            _check_is_whole(file, number, cells, top, separator, width=len(example))
            names = _numbered_names(cells, number, top, separator)
            if names is not None:
                is_numbered = True
                rows.append(names)
                continue
        if _is_of_numbers(cells, example):
            return _Top(separator, number, rows, is_numbered=is_numbered)
        rows.append(cells)
    raise _without_numbers(file)


def _numbered_names(
    cells: list[str], number: int, top: list[tuple[int, str]], separator: str | None
) -> list[str] | None:
    """Return the names in a line that numbers the columns; None if the line does not.

    pandas writes such a line above a table whose columns have no names: 0, 1, 2 and so on. A number
    is no name, so "" stands for it. A few columns can have names, as in 0, 1, 2, label. Fewer than
    three numbers are too few to tell. The next line must be another one.

    Args:
        cells: the cells of the line.
        number: the number of the line, counted from 0.
        top: the first lines of the file that are not empty, with their numbers.
        separator: the separator of the cells; None for blanks.
    """
    names = list[str]()
    for column, cell in enumerate(cells):
        if cell == str(column):
            names.append("")
        elif not cell or NUMBER.fullmatch(cell):
            return None
        else:
            names.append(cell)
    below = [line for other, line in top if other > number and not _is_comment(line)]
    is_enough = names.count("") >= FEWEST_COUNTED
    if not is_enough or not below or split_line(below[0].strip(), separator) == cells:
        return None
    return names


def _without_numbers(file: Path) -> UserError:
    """Return the error of a text that has no line of numbers."""
    return UserError(
        f"{file}: no line of numbers; expected a table of numbers. Correct the file, or move it "
        "out of the folder"
    )


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENT)


def _is_of_numbers(cells: list[str], example: list[str]) -> bool:
    """Return whether a line holds numbers: it begins with one, or has no word in place of one.

    Args:
        cells: the cells of the line.
        example: the cells of a line of numbers.
    """
    pairs = list(zip(cells, example, strict=False))
    if not pairs:
        return False
    if NUMBER.fullmatch(pairs[0][0]):
        return True
    return not any(NUMBER.fullmatch(other) and not NUMBER.fullmatch(cell) for cell, other in pairs)


def _check_is_whole(
    file: Path,
    number: int,
    cells: list[str],
    top: list[tuple[int, str]],
    separator: str | None,
    *,
    width: int,
) -> None:
    """Refuse a table whose first line holds only numbers and is cut at its beginning.

    The first line is the first one that is not empty: no names and no comment stand above it.

    Args:
        file: the file, which the error names.
        number: the number of the line, counted from 0.
        cells: the cells of the line.
        top: the first lines of the file that are not empty, with their numbers.
        separator: the separator of the cells; None for blanks.
        width: the number of cells in the lines below.

    Raises:
        UserError: the line is cut, see `_is_cut`.
    """
    has_only_numbers = any(cells) and all(NUMBER.fullmatch(cell) for cell in cells if cell)
    if not has_only_numbers or not _is_cut(cells, number, top, separator):
        return
    lines = f"line {number + 1} has {several(len(cells), 'cell')}, the lines below have {width}"
    remedy = f"sed -i.bak {number + 1}d {quote(str(file))}"
    raise UserError(f"{file}: {lines}, so its beginning is cut off; delete it: {remedy}")


def _is_cut(
    cells: list[str], number: int, top: list[tuple[int, str]], separator: str | None
) -> bool:
    """Return whether a line of numbers is cut at its beginning.

    The line is compared with the lines below it, of which there must be at least two. The last of
    these is left out, since it can be cut too. All others must have equally many cells. The line is
    cut

    - if it has fewer cells than they have: `14,502` above `510,514,502`;
    - if its first cell is empty: `,514,502`. An exception is the line of names `,0,1` that pandas
      writes, below which the first cells count 0, 1, 2.
    """
    below = [line for other, line in top if other > number and not _is_comment(line)]
    rows = [split_line(line.strip(), separator) for line in below[:-1]]
    counts = {len(row) for row in rows}
    if len(counts) != 1 or len(cells) > min(counts):
        return False
    if cells[0]:
        return len(cells) < min(counts)
    first = [row[0] for row in rows]
    return first != [str(index) for index in range(len(first))]


def separator_of(line: str) -> str | None:
    """Return the separator of the cells of a line; None for blanks.

    `1,5 2,5` has decimal commas. `1 501,1 498` has blanks between groups of digits, and commas
    between its cells.

    Args:
        line: a line of a table, without blanks at its ends.
    """
    cells = line.split(",")
    if len(cells) > 1 and all(re.fullmatch(GROUPED_BY_BLANKS, cell.strip()) for cell in cells):
        return ","
    for mark in (";", "\t"):
        if mark in line:
            return mark
    if "," not in line:
        return None
    words = line.split()
    with_commas = [word for word in words if "," in word]
    are_decimal = all(re.fullmatch(r"[-+\d]\d*,\d[\de+-]*", word) for word in with_commas)
    if len(words) > 1 and are_decimal:
        return None
    return ","


def split_line(line: str, separator: str | None) -> list[str]:
    """Return the cells of a line, without quotes and blanks around them.

    Args:
        line: a line of a table.
        separator: the separator of its cells; None for blanks.
    """
    if not separator:
        cells = line.split()
    elif len(line) > csv.field_size_limit():
        cells = line.split(separator)
    else:
        cells = next(csv.reader([line], delimiter=separator), [])
    return [cell.strip().strip('"') for cell in cells]
