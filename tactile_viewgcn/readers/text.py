"""Tables of numbers as text: a line for each frame, a column for each sensor.

Cells are separated by commas, semicolons, tabs or blanks, with a decimal point or comma. Lines
above the numbers may hold words; the first one with a cell for each column names the columns. Lines
that begin with # or % hold no numbers.
"""

import csv
import gzip
import io
import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_viewgcn.messages import Note, UserError, listed, several
from tactile_viewgcn.readers.child import UNPACKED, UNPACKED_TIMES, check_unpacked, library
from tactile_viewgcn.readers.lines import CONTENTS, LABELS, label_kind
from tactile_viewgcn.readers.numerals import GROUPED_BY_BLANKS, check_numerals, without_group_marks
from tactile_viewgcn.readers.serial import check_is_table
from tactile_viewgcn.readers.source import (
    MAX_PRESSURE,
    MODEL_TOPIC,
    NUMBERS,
    Form,
    Recording,
    label_text,
    setting,
)
from tactile_viewgcn.schema import nearest

if TYPE_CHECKING:
    from pandas import DataFrame, Series

TOP_LINES = 200  # in which the separator and the names are looked for
COMMENT = ("#", "%")
NUMBER = re.compile(r"(?i)[-+]?(\d+([.,]\d*)?|[.,]\d+)(e[-+]?\d+)?|[-+]?(nan|inf|infinity)")
NOT_NUMBERS = re.compile(r"^[ \t]*[#%].*$|^[ \t,;]+$", re.MULTILINE)  # comments and empty lines
BEGINS_OF_NUMBERS = re.compile(r"(?<![\w.])[-+]?\d")
NOT_OF_MODEL = "no sensor of the model"
MOST_SHOWN = 30  # letters of a cell in a message
# of a time, at the end of a name such as time_ms or t [s]
UNIT = re.compile(r" ?[_(\[](s|ms|us|µs|ns)[)\]]?$")
# of a unit; else 1
SECONDS = {"ms": 1e-3, "millis": 1e-3, "us": 1e-6, "µs": 1e-6, "micros": 1e-6, "ns": 1e-9}
MOSTLY = 0.9  # of the steps of a counter, which may have lost lines or begun again
GZIP = b"\x1f\x8b"  # beginning of a packed file
UTF16 = (b"\xff\xfe", b"\xfe\xff")  # beginnings of a text


def read_text(file: Path) -> str:
    """Return the text of a file, packed by gzip or not, with a newline at the end of each line.

    Raises:
        UserError: it unpacks to more than a file of its size may, or holds NUL, as UTF-16 without a
            mark does.
    """
    with file.open("rb") as stream:
        if stream.peek(len(GZIP)).startswith(GZIP):
            most = UNPACKED + UNPACKED_TIMES * file.stat().st_size
            with library(file), gzip.open(stream) as packed:
                data = packed.read(most + 1)
            check_unpacked(file, len(data))
        else:
            data = stream.read()
    try:
        text = data.decode("utf-16" if data.startswith(UTF16) else "utf-8-sig")
    except UnicodeDecodeError:
        # of spreadsheets in western languages; no number is written differently
        text = data.decode("latin-1")
    if "\0" in text:
        raise UserError(f"{file}: no text; expected a table of numbers in UTF-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def table_in(file: Path, text: str, form: Form) -> Recording:
    """Return the table in a text as one recording, with the names in its lines, see `table_of`.

    A line of units below the names is left out, with a note: one with words, or one of ones where
    no other cell is 1.

    Raises:
        UserError: as `table_of`; there are no numbers, or lines of unlike length, or numbers that
            have two readings.
    """
    check_is_table(file, text)
    top = _top(file, text)
    numbers = NOT_NUMBERS.sub("", text)
    check_numerals(file, numbers, top.separator, top.above)
    cells = _cells_of(file, text, numbers, top)
    places = _places(numbers, top.above)
    width = 1 + int(max(np.flatnonzero(cells.notna().any()), default=-1))
    full = [row[:width] for row in top.rows if len(row) >= width and not any(row[width:])]
    # names of columns that are empty at the end
    if not full and top.rows and width < len(top.rows[-1]) <= cells.shape[1]:
        full = top.rows[-1:]
        width = len(top.rows[-1])
    first = split_line(next(islice(io.StringIO(text), top.above, None)), top.separator)
    if full and _are_ones(first, cells, width):
        full.append(first)
        cells = cells.iloc[1:]
        next(places)
    notes = [
        Note(f"the line {listed(row)} below the names is no frame (units)", topic="units")
        for row in full[1:]
    ]
    names = full[0] if full else [""] * width
    table, labels = table_of(names, cells, form, str(file), places)
    return replace(table, notes=notes + table.notes, labels=labels)


def _cells_of(file: Path, text: str, numbers: str, top: "_Top") -> "DataFrame":
    """Return the cells below the top of a text; `numbers` is the text without comments."""
    import pandas as pd  # here, since it loads slowly

    has_decimal_commas = top.separator != "," and re.search(r"\d,\d", text)
    with (
        warnings.catch_warnings(),
        # texts of Arrow need more memory than the child process may take
        pd.option_context("mode.string_storage", "python"),
        library(file),
    ):
        # pandas 3.1 rounds as float_precision asks for by itself
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            return pd.read_csv(
                io.StringIO(numbers),
                sep=top.separator or r"\s+",
                decimal="," if has_decimal_commas else ".",
                header=None,
                skiprows=top.above,
                keep_default_na=False,
                na_values=[""],
                skipinitialspace=True,
                float_precision="round_trip",
                low_memory=False,
            )
        except pd.errors.ParserError as error:  # such as `Expected 2 fields in line 3, saw 4`
            what = str(error).rpartition("error: ")[2].strip()
            raise UserError(f"{file}: {what}; correct or delete the line") from None


def _are_ones(first: list[str], cells: "DataFrame", width: int) -> bool:
    """Return whether the first line of cells is one of units: ones, where no other cell is 1."""
    if width < 2 or first.count("1") != width or len(cells) < 3:
        return False
    return bool((cells.iloc[:, :width] == 1).sum().eq(1).all())


def _places(text: str, above: int) -> Iterator[str]:
    """Yield `line N` of each row of a table, as an editor counts, with empty lines.

    The rows stand below the first `above` lines.
    """
    # a copy of the text, made where a cell is named, since it takes memory
    for number, line in enumerate(io.StringIO(text), 1):
        if number > above and line != "\n":
            yield f"line {number}"


@dataclass
class _Table:
    """What was found in the columns of a table so far."""

    channels: list[str] = field(default_factory=list)
    readings: list[np.ndarray] = field(default_factory=list)
    time: np.ndarray | None = None
    labels: dict[str, Any] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)


def table_of(
    names: list[str], cells: "DataFrame", form: Form, file: str, places: Iterable[str]
) -> tuple[Recording, dict[str, Any]]:
    """Return a table of T lines as one recording, and its columns of labels.

    Args:
        names: of the columns, "" without one, which then goes by its number from 1.
        cells: has numbers from 0 as names of its columns.
        form: what the user says of the columns.
        file: with which errors begin.
        places: of each row of `cells`, for an error.

    Returns:
        The recording: pressure (T, S), the times if a column has them, and notes on the columns
        that are no sensors. And a dict of the columns that hold labels: by `session`, `object` or
        `recording` the T texts of that column.

    Raises:
        UserError: a cell without a number or a name, or no column of a name that the form gives.
    """
    keys = [name or str(number) for number, name in enumerate(names, 1)]
    for kind, name in form.names.items():
        if name not in keys and (form.labelled or kind not in LABELS):
            raise UserError(
                f"{file}: no column {name!r}{nearest(name, keys)}; found {listed(keys)}"
            )
    of_model = sensors_of_model(keys, form, file)
    table = _Table()
    for number, (name, key) in enumerate(zip(names, keys, strict=True)):
        column = _Column(number, name, key, cells[number], _numbers(cells[number]))
        content = _content_of(column, form, of_model, has_names=any(names))
        if key in of_model and content:
            what = f"column {number + 1} ({key!r}), a sensor of the model, is {content}"
            raise UserError(f"{file}: {what}; record it again")
        _add_column(table, column, content, file, places)
    channels = table.channels
    readings = table.readings
    if of_model:
        readings = [readings[channels.index(name)] for name in of_model]
        channels = list(of_model)
    values: dict[str, Any] = {"pressure": np.zeros((len(cells), 0))}
    if readings:
        values["pressure"] = np.column_stack(readings)
    if table.time is not None:
        values["time"] = table.time
    if not any(channels):
        channels = []
    left_out = [key for key in keys if key in form.left_out]
    recording = Recording({}, values, channels, table.notes, left_out=left_out)
    return recording, table.labels


@dataclass(frozen=True)
class _Column:
    """A column of a table.

    Attributes:
        number: from 0.
        name: "" without one.
        key: its name, or its number from 1.
        cells: as they stand in the table.
        values: (T,) numbers, NaN where a cell is none.
    """

    number: int
    name: str
    key: str
    cells: "Series"
    values: np.ndarray

    def __str__(self) -> str:
        text = f"column {self.number + 1}"
        if self.name:
            text += f" ({self.name!r})"
        return text


def _content_of(column: _Column, form: Form, of_model: list[str], *, has_names: bool) -> str:
    """Return what a column holds, or why it is left out; "" for readings."""
    if column.key in form.left_out:
        return "left out by data.columns"
    if len(column.cells) and column.cells.isna().all():
        return f"empty in all {len(column.cells)} lines"
    if column.key in of_model:
        return ""
    is_index = column.number == 0 and not column.name and has_names
    content = _content(column.key, column.values, form, is_index=is_index)
    if not of_model or content:
        return content
    content = NOT_OF_MODEL
    if is_words(column.cells) and column.cells.nunique() > 1:
        remedy = setting(f"data.columns=[object:{column.key}]")
        content += f"; if it names the objects of several recordings, {remedy}"
    return content


def _add_column(
    table: _Table, column: _Column, content: str, file: str, places: Iterable[str]
) -> None:
    """Add a column to what was found in a table; a column that is no sensor gets a note."""
    filled = np.abs(column.values) <= MAX_PRESSURE
    if content in LABELS:
        filled = column.cells.notna().to_numpy()
    if content in ("", *LABELS) and not filled.all():
        raise UserError(f"{file}: {_unfit(file, column, filled, content, places)}")
    if not content:
        table.readings.append(column.values)
        table.channels.append(column.name)
        return
    if content in LABELS and content not in table.labels:
        table.labels[content] = _labels_of(column.cells)
    elif content == "time" and filled.all():
        if table.time is None:
            _, unit = base_and_unit(column.name)
            table.time = column.values * SECONDS.get(unit, 1.0)
    elif content == "time":
        example = str(column.cells[~filled].iloc[0])
        count = f"{np.sum(~filled)} of {len(filled)} cells are no number"
        content = f"time, not used: {count}, such as {example!r}"
    topic = MODEL_TOPIC if content.startswith(NOT_OF_MODEL) else "columns"
    text = f"{column} is no sensor ({content})"
    table.notes.append(Note(text, topic=topic, value=column.number + 1))


def _labels_of(cells: "Series") -> Any:
    """Return the texts (T,) of a column, of which each is kept once."""
    import pandas as pd  # here, since it loads slowly

    codes, values = pd.factorize(cells)
    texts = np.array([label_text(value) for value in values], dtype=object)
    numbers, unique = pd.factorize(texts)  # 1 and 1.0 are one label
    return pd.Categorical.from_codes(numbers[codes], categories=unique)


def sensors_of_model(keys: list[str], form: Form, file: str) -> list[str]:
    """Return the names of the columns that are sensors of the model, in the model's order.

    If files are joined by a PART in the layout, a file has a part of the sensors only: the column
    `thumb` of the left hand's file is the sensor `left_thumb`. The names are then in the order of
    the columns, and a missing one is no error.

    Args:
        keys: names of the columns.
        form: has the names of the model's sensors.
        file: with which errors begin.

    Returns:
        No names, if no column has one of the model's, or names do not tell the sensors apart.

    Raises:
        UserError: without PART, some of the model's sensors are there and others are not.
    """
    wanted = [*form.sensors]
    if "PART" in form.layout:
        parts = [name for name in keys if any(sensor.endswith(f"_{name}") for sensor in wanted)]
        return [name for name in dict.fromkeys(parts) if keys.count(name) == 1]
    found = [name for name in wanted if name in keys]
    are_unlike = len(set(wanted)) == len(wanted) and "" not in wanted  # "" has no name
    if not found or not are_unlike or any(keys.count(name) > 1 for name in found):
        return []
    left_out = [name for name in wanted if name in form.left_out]
    if left_out:
        remedy = "take leave_out of it from data.columns"
        raise UserError(f"{file}: {listed(left_out)} is a sensor of the model; {remedy}")
    missing = [name for name in wanted if name not in keys]
    if missing:
        what = f"no column {listed(missing)} of the model's sensors; found {listed(keys)}"
        raise UserError(f"{file}: {what}; rename the columns as in the training")
    return found


def _unfit(
    file: str, column: _Column, filled: np.ndarray, content: str, places: Iterable[str]
) -> str:
    """Return what is wrong with a column of sensors or of names, where, and what to type."""
    cells = column.cells
    values = column.values
    grouped = "" if content else _in_groups(file, cells, filled)
    if grouped:
        return f"{column}: {grouped}"
    row = int(np.argmin(filled))
    leave_out = setting(f"data.columns=[leave_out:{column.key}]")
    repeats = cells.nunique() < len(cells)
    if not content and np.isnan(values).all() and repeats and is_words(cells):
        example = str(cells.iloc[0])[:MOST_SHOWN]
        is_label = setting(f"data.columns=[object:{column.key}]")
        words = f"{column} holds words, such as {example!r}, and no number"
        return f"{words}; if it names the objects, {is_label}; else {leave_out}"
    what = "a number"
    if content:
        what = "a name"
    elif not np.isnan(values[row]):
        what = f"a number up to {MAX_PRESSURE:g}"
    place = next(islice(places, row, None))
    return f"{place}, {column} is not {what}; correct or delete the line, or {leave_out}"


def _in_groups(file: str, cells: "Series", filled: np.ndarray) -> str:
    """Return what to type where digits are in groups, as in 1.012,5; "" where no cell is so.

    The first cells that are not `filled` are looked at.
    """
    for cell in cells[~filled].iloc[:TOP_LINES]:
        command = without_group_marks(file, str(cell))
        if command:
            shown_cell = str(cell)[:MOST_SHOWN]
            what = f"{shown_cell!r} has marks between groups of digits"
            return f"{what}; to write it plainly: {command}"
    return ""


def is_words(cells: "Series") -> bool:
    """Return whether all cells are words: letters, perhaps with digits after them."""
    return all(re.fullmatch(r"[^\W\d_][\w .-]*", str(cell)) for cell in cells.unique())


def _content(name: str, values: np.ndarray, form: Form, *, is_index: bool) -> str:
    """Return what a column (T,) holds by its name, or why it is left out; "" for readings."""
    for kind, column in form.names.items():
        if column == name:
            return "" if kind == "pressure" else kind
    last = _last_part(name)
    content = "line number"
    if not is_index:
        content = content_by_name(name)
    # words, or whole numbers
    if not content and (np.isnan(values).any() or not (values % 1).any()):
        content = label_kind(name)
    steps = np.diff(values)
    is_counter = np.sum(steps == 1) > MOSTLY * len(steps)
    rises = np.sum(steps > 0) > MOSTLY * len(steps)
    # such as the index finger
    is_sensor_named_like_index = content == "line number" and not is_counter
    is_temperature = last.lower() == "t" and not rises
    if is_sensor_named_like_index or is_temperature:
        content = ""
    if (content or "pressure") in form.names:
        return "data.columns names others"
    return content


def content_by_name(name: str) -> str:
    """Return what a column without readings holds by its name, but for labels in other words.

    A column `.header.stamp.time` holds times too.

    Args:
        name: of the column.

    Returns:
        A value of `CONTENTS`; "" for readings.
    """
    base, _ = base_and_unit(_last_part(name))
    return CONTENTS.get(base, "")


def _last_part(name: str) -> str:
    """Return the last part of the name of a field, as ROS writes it: seq of .header.seq."""
    return re.split("[./]", name)[-1]


def base_and_unit(name: str) -> tuple[str, str]:
    """Return a name in small letters without its unit of time, and the unit.

    A name such as `millis` is both.

    Args:
        name: of a column.
    """
    base, *found = UNIT.split(name.lower())
    unit = found[0] if found else ""
    return base, unit or base


def _numbers(cells: "Series") -> np.ndarray:
    """Return the cells of a column (T,) as integers, float64 or bool; NaN where one is no number.

    A column of True and False stays bool. Beside columns of numbers it becomes a sensor of ones and
    zeros, unless its name says that it holds something else.
    """
    from pandas import to_numeric

    if isinstance(cells.dtype, np.dtype) and cells.dtype.kind in NUMBERS:
        return np.asarray(cells.to_numpy())
    texts = np.array([str(cell).replace(",", ".") for cell in cells], dtype=object)
    return np.asarray(to_numeric(texts, errors="coerce"))


@dataclass(frozen=True)
class _Top:
    """What stands at the top of a table.

    Attributes:
        separator: of its cells, None for blanks.
        above: number of lines above the numbers.
        rows: the cells of these lines.
    """

    separator: str | None
    above: int
    rows: list[list[str]]


def _top(file: Path, text: str) -> _Top:
    """Return the separator of a table, and the lines above its numbers.

    A line above the numbers is a comment, or begins with a word and has words where the lines below
    have numbers. Logging may have begun in the middle of a line, so a file's first line may be cut.
    If anything stands above the first line of numbers, even a comment, this is not looked for.

    Raises:
        UserError: there is no line of numbers, or the file begins with one that is cut.
    """
    top = list[tuple[int, str]]()
    for number, line in enumerate(islice(io.StringIO(text), TOP_LINES)):
        if line.strip(" \t\n,;"):
            top.append((number, line))
    below = [line for _, line in top if not _is_comment(line)][-3:]
    sample = max(below, key=lambda line: len(BEGINS_OF_NUMBERS.findall(line)), default="")
    separator = separator_of(sample.strip())
    example = split_line(sample, separator)
    rows = list[list[str]]()
    for number, line in top:
        cells = split_line(line.lstrip("".join(COMMENT) + " "), separator)
        if not _is_comment(line):
            if not rows:
                _check_is_whole(file, number, cells, top, separator, width=len(example))
            if _is_of_numbers(cells, example):
                return _Top(separator, number, rows)
        rows.append(cells)
    raise UserError(f"{file}: no line of numbers; expected a table of numbers")


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENT)


def _is_of_numbers(cells: list[str], example: list[str]) -> bool:
    """Return whether cells begin with a number, or have no words where an example has numbers."""
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
    """Refuse a table whose first line holds numbers only and is cut at its beginning.

    The line is the first one that is not empty: no names and no comment stand above it.

    Args:
        file: with which the error begins.
        number: of the line, from 0.
        cells: of the line.
        top: the first lines of the file that are not empty, with their numbers.
        separator: of the cells, None for blanks.
        width: number of cells of the lines below.

    Raises:
        UserError: the line is cut, see `_is_cut`.
    """
    has_only_numbers = any(cells) and all(NUMBER.fullmatch(cell) for cell in cells if cell)
    if not has_only_numbers or not _is_cut(cells, number, top, separator):
        return
    lines = f"line {number + 1} has {several(len(cells), 'cell')}, the lines below have {width}"
    remedy = f"sed -i.bak {number + 1}d {quote(str(file))}"
    raise UserError(f"{file}: {lines}, as one that is cut; delete it: {remedy}")


def _is_cut(
    cells: list[str], number: int, top: list[tuple[int, str]], separator: str | None
) -> bool:
    """Return whether a line of numbers is cut at its beginning.

    It is compared with the lines below it, of which there must be two or more. The last of these
    is left out, since it may be cut too. All others must have equally many cells. The line is cut

    - if it has fewer cells than they have: `14,502` above `510,514,502`;
    - if its first cell is empty: `,514,502`. An exception is the line of names that pandas writes,
      `,0,1`, below which the first cells count 0, 1, 2.
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
    """Return the separator of the cells of a line, None for blanks.

    `1,5 2,5` has decimal commas. `1 501,1 498` has blanks between groups of digits, and commas
    between its cells.

    Args:
        line: of a table, without blanks at its ends.
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
        line: of a table.
        separator: of its cells, None for blanks.
    """
    if not separator:
        cells = line.split()
    elif len(line) > csv.field_size_limit():
        cells = line.split(separator)
    else:
        cells = next(csv.reader([line], delimiter=separator), [])
    return [cell.strip().strip('"') for cell in cells]
