"""Reading tables of numbers as programs write them: spreadsheets, pandas, R, MATLAB, LabVIEW, loggers.

Cells are separated by commas, semicolons, tabs or blanks, with a decimal point or comma. Lines of words may stand above
the numbers; the first of these with a cell for each column has the
columns' names. Lines that begin with # or % hold no
numbers, and a line may end with a separator.
"""

import codecs
import csv
import gzip
import io
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_viewgcn.messages import UserError

if TYPE_CHECKING:
    from pandas import DataFrame

MAX_COLUMNS = 2**16
COMMENT = ("#", "%")
EMPTY = " \t,;"  # an empty line has nothing else


@dataclass(frozen=True)
class Table:
    """The table in a file.

    Attributes:
        names: of the columns; "" where one has none.
        cells: (lines, columns) numbers, or texts in a column with any; NaN where empty.
        decimal: the decimal mark.
        heading: number of lines above the numbers that are not empty.
        is_shown: whether messages may quote the file: not one outside the source, to which a link leads and which the
            user may not mean to show.
    """

    file: Path
    names: list[str]
    cells: "DataFrame"
    decimal: str
    heading: int
    is_shown: bool

    def line(self, row: int) -> int:
        """The number, as an editor counts, of a line of cells."""
        lines = [(at, text) for at, text in enumerate(_text(self.file).split("\n"), 1) if text.strip(EMPTY)]
        return [at for at, text in lines[self.heading :] if not _is_comment(text)][row]

    def values(self, columns: Sequence[int]) -> np.ndarray:
        """Some columns (lines, columns): int64 where all are whole numbers, else float64, NaN where a cell is none."""
        from pandas import to_numeric

        cells = self.cells[list(columns)].copy()
        for column in cells.select_dtypes(exclude="number"):
            texts = [str(cell).replace(self.decimal, ".") for cell in cells[column]]  # Arrow's need too much memory
            cells[column] = to_numeric(np.array(texts, dtype=object), errors="coerce")
        return cells.to_numpy(None if {kind.kind for kind in cells.dtypes} == {"i"} else np.float64)

    def numbers(self, columns: Sequence[int]) -> np.ndarray:
        """`values` of some columns, if all are numbers.

        Raises:
            UserError: names line and column of the first cell without a number.
        """
        numbers = self.values(columns)
        for row, at in np.argwhere(np.isnan(numbers))[:1]:
            text = self.cells[columns[at]].iat[row]
            what = "is empty" if not isinstance(text, str) else f"is {text[:40]!r}" if self.is_shown else "is no number"
            raise UserError(
                f"{self.file}: line {self.line(row)}, column {columns[at] + 1} {what}; expected a number in each cell: "
                "correct it or delete the line, and save each recording as a file of its own"
            )
        return numbers


def read_table(file: Path, source: Path) -> Table:
    """The table in a text file of a source, or in one that gzip has packed.

    Raises:
        UserError: there are no numbers, too many columns, or a line of more cells than others.
    """
    import pandas as pd  # here, since it loads slowly

    text = re.sub(r"\n[\s,;]*\n", "\n", _text(file))  # a list of millions of empty lines would fill the memory
    lines = [line for line in text.split("\n") if line.strip(EMPTY)]
    sample = max(lines[-3:], key=lambda line: len(re.findall(r"(?<![\w.])[-+]?\d", line)), default="")
    separator = _separator(sample.strip())
    example = _cells(sample, separator)
    width = 1 + max((at for at, cell in enumerate(example) if cell), default=-1)
    heading = lines[:1] if lines and _are_numbers_as_names(_cells(lines[0], separator)) else []
    heading += takewhile(lambda line: _is_heading(line, separator, example[:width]), lines[len(heading) :])
    body = [line for line in lines[len(heading) :] if not _is_comment(line)]
    longest = max(width, *(len(line.split(separator)) for line in body), 0)
    if not body or longest > MAX_COLUMNS:
        problem = f"{longest:,} columns" if body else "no line of numbers" if lines else "empty"
        raise UserError(f"{file}: {problem}; expected a table of numbers, of up to {MAX_COLUMNS:,} columns")
    decimal = "," if separator != "," and any(re.search(r"\d,\d", line) for line in body) else "."
    # texts of pandas, since those of Arrow need more memory than the child process may take
    with warnings.catch_warnings(), pd.option_context("mode.string_storage", "python"):
        warnings.simplefilter("ignore", DeprecationWarning)  # pandas 3.1 rounds as float_precision asks for by itself
        cells = pd.read_csv(
            io.BytesIO("\n".join(body).encode()),
            sep=separator or r"\s+",
            decimal=decimal,
            names=range(longest),
            index_col=False,
            keep_default_na=False,
            na_values=[""],
            skipinitialspace=True,
            float_precision="round_trip",
            low_memory=False,
        )
    names, is_shown = _names(heading, separator, width), file.resolve().is_relative_to(source.resolve())
    table = Table(file, names, cells.iloc[:, :width], decimal, len(heading), is_shown)
    for row in np.flatnonzero(cells.iloc[:, width:].notna().any(axis=1))[:1]:
        what = f"more than {width} cells, the number in other lines; correct it or delete the line"
        raise UserError(f"{file}: line {table.line(row)} has {what}")
    return table


def _text(file: Path) -> str:
    """The text of a file, with a newline at the end of each line.

    Raises:
        UserError: it holds NUL, as files that are no text do, or UTF-16 without a byte-order mark.
    """
    data = file.read_bytes()
    if data.startswith(b"\x1f\x8b"):
        data = gzip.decompress(data)
    try:
        text = data.decode("utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # of spreadsheets in western languages; no number is written differently
    if "\0" in text:
        raise UserError(f"{file}: no text; expected a table of numbers in UTF-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _separator(line: str) -> str | None:
    """The separator of the cells of a line, None for blanks."""
    if ";" in line:
        return ";"
    plain = re.sub(r"(?<=\d),(?=\d)", ".", line)  # of numbers with a decimal comma
    words = plain.split()
    if "," in line and ("," in plain or len(words) < 2 or not all(_is_number(word) for word in words if "." in word)):
        return ","
    return "\t" if "\t" in line else None


def _cells(line: str, separator: str | None) -> list[str]:
    cells = next(csv.reader([line], delimiter=separator)) if separator else line.split()
    return [cell.strip() for cell in cells]


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENT)


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _is_heading(line: str, separator: str | None, example: list[str]) -> bool:
    """Whether a line belongs above the numbers, with the cells of a line of numbers for comparison.

    It is a comment, or begins with a word and has a word in place of a number or a different length.
    """
    cells = _cells(line, separator)
    filled = [cell for cell in cells if cell] or [""]
    is_unlike = len(cells) != len(example) or any(
        cell and not _is_number(cell) and _is_number(number) for cell, number in zip(cells, example, strict=True)
    )
    return _is_comment(line) or (not _is_number(filled[0]) and is_unlike)


def _are_numbers_as_names(cells: list[str]) -> bool:
    """Whether a first line is 0, 1, 2 or 1, 2, 3, as programs name columns, with or without an empty cell before."""
    names = cells[not cells[0] :]
    return len(cells) > 2 and any(names == [str(first + at) for at in range(len(names))] for first in (0, 1))


def _names(heading: list[str], separator: str | None, width: int) -> list[str]:
    """Names of the columns: the cells of the first line above the numbers that has one for each.

    Where none has, those of the first line that is no comment; of blanks that may be a sentence.
    """
    rows = [_cells(line.lstrip("".join(COMMENT) + " "), separator) for line in heading]
    rows = [row[:-1] if len(row) > width and not row[-1] else row for row in rows]  # a separator at the end
    if rows and len(rows[-1]) + 1 == width > 2 and not any(map(_is_number, rows[-1])):
        rows[-1] = ["", *rows[-1]]  # R names no column of row names
    shorter = [row for row, line in zip(rows, heading, strict=True) if separator and not _is_comment(line)]
    names = next((row for row in rows if len(row) == width), [*shorter, []][0])[:width]
    return names + [""] * (width - len(names))
