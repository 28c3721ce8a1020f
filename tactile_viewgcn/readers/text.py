"""Reading tables of numbers as text: a line for each frame, whose columns are sensors, times, line numbers and names.

Cells are separated by commas, semicolons, tabs or blanks, with a decimal point or comma. Lines above the numbers may
hold words; the first one with a cell for each column names the columns. Lines that begin with # or % hold no numbers.
"""

import csv
import gzip
import io
import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_viewgcn.messages import Note, UserError, listed, several
from tactile_viewgcn.readers.source import MAX_PRESSURE, NUMBERS, Form, Recording, setting, tidy

if TYPE_CHECKING:
    from pandas import DataFrame, Series

TOP = 200  # lines in which the separator and the names are looked for
COMMENT = ("#", "%")
NUMBER = re.compile(r"(?i)[-+]?(\d+([.,]\d*)?|[.,]\d+)(e[-+]?\d+)?|[-+]?(nan|inf|infinity)")
NOT_NUMBERS = re.compile(r"^[ \t]*[#%].*$|^[ \t,;]+$", re.MULTILINE)  # comments and empty lines
#: What columns without readings hold, by their names in small letters.
CONTENTS = {
    **dict.fromkeys(("time", "timestamp", "t", "ms", "millis", "micros"), "time"),
    **dict.fromkeys(("sample", "frame", "index"), "line number"),
    **dict.fromkeys(("object", "label", "class", "gesture", "target"), "object"),
    **dict.fromkeys(("recording", "trial"), "recording"),
    **dict.fromkeys(("session", "subject", "person", "participant"), "session"),
}
LABELS = ("session", "object", "recording")
UNIT = re.compile(r" ?[_(\[](s|ms|us|µs|ns)[)\]]?$")  # of a time, at the end of a name such as time_ms or t [s]
SECONDS = {"ms": 1e-3, "millis": 1e-3, "us": 1e-6, "µs": 1e-6, "micros": 1e-6, "ns": 1e-9}  # of a unit; else 1
Table = tuple[Recording, dict[str, np.ndarray]]  # of all lines, and the names in them, see `table_of`
MOSTLY = 0.9  # of the steps of a counter, which may have lost lines or begun again


def read_table(file: Path, form: Form) -> Table:
    """The table in a text file, see `table_of`.

    A line of units below the names is left out, with a note: one with words, or one of ones where no other cell is 1.

    Raises:
        UserError: as `table_of`; there are no numbers, or lines of unlike length.
    """
    import pandas as pd  # here, since it loads slowly

    text = _text(file)
    separator, above, rows = _top(file, text)
    numbers = NOT_NUMBERS.sub("", text)
    places = _places(numbers, above)
    # texts of pandas, since those of Arrow need more memory than the child process may take
    with warnings.catch_warnings(), pd.option_context("mode.string_storage", "python"):
        warnings.simplefilter("ignore", DeprecationWarning)  # pandas 3.1 rounds as float_precision asks for by itself
        try:
            cells = pd.read_csv(
                io.StringIO(numbers),
                sep=separator or r"\s+",
                decimal="," if separator != "," and re.search(r"\d,\d", text) else ".",
                header=None,
                skiprows=above,
                keep_default_na=False,
                na_values=[""],
                skipinitialspace=True,
                float_precision="round_trip",
                low_memory=False,
            )
        except pd.errors.ParserError as error:  # such as `Expected 2 fields in line 3, saw 4`
            what = str(error).rpartition("error: ")[2].strip()
            raise UserError(f"{file}: {what}; correct or delete the line") from None
    width = 1 + max(np.flatnonzero(cells.notna().any()), default=-1)
    full = [row[:width] for row in rows if len(row) >= width and not any(row[width:])]
    first = _cells(next(islice(io.StringIO(text), above, None)), separator)
    if not full and rows and width < len(rows[-1]) <= cells.shape[1]:  # names of columns that are empty at the end
        full, width = rows[-1:], len(rows[-1])
    if full and 1 < width == first.count("1") and len(cells) > 2 and (cells.iloc[:, :width] == 1).sum().eq(1).all():
        full, cells, _ = [*full, first], cells.iloc[1:], next(places)
    notes = [Note(f"the line {listed(row)} below the names is no frame (units)", topic="units") for row in full[1:]]
    table, labels = table_of((full or [[""] * width])[0], cells, form, str(file), places)
    return replace(table, notes=notes + table.notes), labels


def _places(text: str, above: int) -> Iterator[str]:
    """`line N` of each row of a table below the first `above` lines, as an editor counts, with empty lines."""
    # a copy of the text, made where a cell is named, since it takes memory
    yield from (f"line {at}" for at, line in enumerate(io.StringIO(text), 1) if at > above and line != "\n")


def table_of(names: list[str], cells: "DataFrame", form: Form, file: str, places: Iterable[str]) -> Table:
    """A table as one recording, and the names in its lines.

    The recording has pressure (T, S), times if a column has them, and notes on the columns without readings. The names
    are by `session`, `object` and `recording` the texts (T,) of columns that have names of these.

    Args:
        names: of the columns, "" without one; those of `cells` are numbers from 0.
        places: of each row of `cells`, for an error.

    Raises:
        UserError: begins with `file`; a cell without a number or a name, or no column of a name that the form gives.
    """
    for kind, name in form.names.items():
        if name not in names and (form.labelled or kind not in LABELS):
            raise UserError(f"{file}: no column {name!r}; found {listed(names)}")
    labels, time = dict[str, np.ndarray](), dict[str, np.ndarray]()
    sensors, channels, notes = [], [], list[Note]()
    for at, name in enumerate(names):
        values, key = _numbers(cells[at]), name or str(at + 1)
        content = _content(name, values, form, is_index=at == 0 and not name and any(names))
        if key in form.left_out or (cells[at].isna().all() and len(cells)):
            content = "left out by data.columns" if key in form.left_out else f"empty in all {len(cells)} lines"
        filled = cells[at].notna().to_numpy() if content in LABELS else np.abs(values) <= MAX_PRESSURE
        column = f"column {at + 1}{f' ({name!r})' if name else ''}"
        if content in ("", *LABELS) and not filled.all():
            row = int(np.argmin(filled))
            what = "a name" if content else "a number" if np.isnan(values[row]) else f"a number up to {MAX_PRESSURE:g}"
            remedy = f"correct or delete the line, or {setting(f'data.columns=[leave_out:{key}]')}"
            raise UserError(f"{file}: {next(islice(places, row, None))}, {column} is not {what}; {remedy}")
        if not content:
            sensors.append(values)
            channels.append(name)
            continue
        if content in LABELS:
            labels.setdefault(content, np.array([tidy(str(cell)) for cell in cells[at]], dtype=object))
        elif content == "time" and filled.all():
            time.setdefault("time", values * SECONDS.get(_base_and_unit(name)[1], 1.0))
        elif content == "time":
            example = str(cells[at][~filled].iloc[0])
            content = f"time, not used: {np.sum(~filled)} of {len(cells)} cells are no number, such as {example!r}"
        notes.append(Note(f"{column} is no sensor ({content})", topic="columns"))
    pressure = np.column_stack(sensors) if sensors else np.zeros((len(cells), 0))
    left_out = [name or str(at) for at, name in enumerate(names, 1) if (name or str(at)) in form.left_out]
    return Recording({}, {"pressure": pressure} | time, channels if any(channels) else [], notes, 0, left_out), labels


def recordings_in(table: Recording, labels: dict[str, np.ndarray], place: str) -> list[Recording]:
    """The recordings in one table of all, see `table_of`: the lines of one session, object and recording.

    Where no column names recordings, one begins where the object or the session changes, and where the time falls.
    Names begin with a place, if there is one; that of a recording alone is the place.
    """
    keys = {kind: labels[kind] for kind in LABELS if kind in labels}
    if "recording" not in keys:
        begins = np.arange(len(table.values["pressure"])) == 0
        for texts in keys.values():
            begins[1:] |= texts[1:] != texts[:-1]
        if "time" in table.values:
            begins[1:] |= np.diff(table.values["time"]) < 0
        keys["recording"] = np.cumsum(begins).astype(str)
    lines, parts = dict[tuple[str, ...], list[int]](), []
    for line, key in enumerate(zip(*keys.values(), strict=True)):
        lines.setdefault(key, []).append(line)
    notes, counts = table.notes, sorted(map(len, lines.values()))
    if labels and "recording" not in labels and len(lines) > 1:
        text = f"{several(len(lines), 'recording')} of {counts[0]:,} to {counts[-1]:,} lines are runs of an object; if "
        remedy = setting("data.columns=[recording:NAME]")
        text += f"these are not what was recorded, add a column `recording`, or {remedy}"
        notes = [*notes, Note(text, "info" if "time" in table.values else "warning", "recordings")]
    for key, index in lines.items():
        run = [*key] if len(lines) > 1 or not place else []
        names = dict(zip(keys, key, strict=True)) | {"recording": "/".join([*filter(None, [place]), *run])}
        values = {name: each[index] for name, each in table.values.items()}
        parts.append(replace(table, names=names, values=values, notes=notes))
    return parts


def _content(name: str, values: np.ndarray, form: Form, *, is_index: bool) -> str:
    """What a column (T,) holds by its name: a value of `CONTENTS`, why it is left out, or "" for readings."""
    if kinds := [kind for kind, column in form.names.items() if column == name]:
        return kinds[0].replace("pressure", "")
    content = "line number" if is_index else CONTENTS.get(_base_and_unit(name)[0], "")
    steps = np.diff(values)
    counts, rises = (np.sum(each) > MOSTLY * len(steps) for each in (steps == 1, steps > 0))
    if (content == "line number" and not counts) or (name.lower() == "t" and not rises):  # a finger, a temperature
        content = ""
    return "data.columns names others" if (content or "pressure") in form.names else content


def _base_and_unit(name: str) -> tuple[str, str]:
    """A name in small letters without its unit of time, and the unit; a name such as `millis` is both."""
    base, unit, *_ = (*UNIT.split(name.lower()), "")
    return base, unit or base


def _numbers(cells: "Series") -> np.ndarray:
    """The cells of a column (T,) as int64 or float64, NaN where one is no number."""
    from pandas import to_numeric

    if isinstance(cells.dtype, np.dtype) and cells.dtype.kind in NUMBERS:
        return cells.to_numpy()
    return to_numeric(np.array([str(cell).replace(",", ".") for cell in cells], dtype=object), errors="coerce")


def _text(file: Path) -> str:
    """The text of a file, with a newline at the end of each line; a UserError for NUL, as in UTF-16 without a mark."""
    data = file.read_bytes()
    if data.startswith(b"\x1f\x8b"):
        data = gzip.decompress(data)
    try:
        text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # of spreadsheets in western languages; no number is written differently
    if "\0" in text:
        raise UserError(f"{file}: no text; expected a table of numbers in UTF-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _top(file: Path, text: str) -> tuple[str | None, int, list[list[str]]]:
    """The separator of a table, None for blanks; the number of lines above its numbers; and the cells of these lines.

    A line above the numbers is a comment, or begins with a word and has words where the lines below have numbers.
    """
    top = [(number, line) for number, line in enumerate(islice(io.StringIO(text), TOP)) if line.strip(" \t\n,;")]
    below = [line for _, line in top if not line.lstrip().startswith(COMMENT)][-3:]
    sample = max(below, key=lambda line: len(re.findall(r"(?<![\w.])[-+]?\d", line)), default="")
    separator = _separator(sample.strip())
    example, rows = _cells(sample, separator), list[list[str]]()
    for number, line in top:
        cells = _cells(line.lstrip("".join(COMMENT) + " "), separator)
        pairs = [(NUMBER.fullmatch(cell), NUMBER.fullmatch(other)) for cell, other in zip(cells, example, strict=False)]
        has_words = any(is_number and not cell for cell, is_number in pairs)
        if not line.lstrip().startswith(COMMENT) and (pairs[0][0] or not has_words):
            return separator, number, rows
        rows.append(cells)
    raise UserError(f"{file}: no line of numbers; expected a table of numbers")


def _separator(line: str) -> str | None:
    """The separator of the cells of a line, None for blanks; `1,5 2,5` has decimal commas."""
    words = line.split()
    is_decimal = len(words) > 1 and all(re.fullmatch(r"[-+\d]\d*,\d[\de+-]*", word) for word in words if "," in word)
    return next((mark for mark in (";", "\t", ",") if mark in line and not (mark == "," and is_decimal)), None)


def _cells(line: str, separator: str | None) -> list[str]:
    cells = next(csv.reader([line], delimiter=separator)) if separator else line.split()
    return [cell.strip().strip('"') for cell in cells]
