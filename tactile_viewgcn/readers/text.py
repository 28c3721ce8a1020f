"""Reading tables of numbers as text: a line for each frame, whose columns are sensors, times, line numbers and names.

Cells are separated by commas, semicolons, tabs or blanks, with a decimal point or comma. Lines above the numbers may
hold words; the first one with a cell for each column names the columns. Lines that begin with # or % hold no numbers.
"""

import codecs
import csv
import gzip
import io
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.readers.source import NUMBERS, Form, Recording, framed, listed

if TYPE_CHECKING:
    from pandas import Series

TOP = 200  # lines in which the separator and the names are looked for
COMMENT = ("#", "%")
EMPTY = " \t\n,;"  # an empty line has nothing else
NOT_NUMBERS = re.compile(r"^[ \t]*[#%].*$|^[ \t,;]+$", re.MULTILINE)  # comments and empty lines
MOST_LETTERS = 40  # of a sensor's name
UNITS = {  # seconds of a unit of time, by the words for it
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "micros", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nanos", "nanosecond", "nanoseconds"), 1e-9),
}
TIMES = {"time", "timestamp", "systime", "stamp", "tstamp", "elapsed", "clock", "millis", "micros", "ms", "t"}
ABOUT_TIMES = {"date", "sys", "system", "log", "unix", "epoch", "utc", "local", "since", "start", *UNITS}
LINE_NUMBERS = {"sample", "samples", "frame", "frames", "row", "line", "packet", "index", "idx", "id", "seq"}
LINE_NUMBERS |= {"sequence", "n", "no", "nr", "num", "number", "count", "counter", "#", "unnamed"}
NAMES = {
    "object": {"object", "label", "class", "gesture", "target"},
    "recording": {"recording", "trial"},
    "session": {"session", "subject"},
}
MOSTLY = 0.9  # of the steps of a counter, which may have lost lines


@dataclass(frozen=True)
class Table:
    """The table in a file of T lines of numbers.

    Attributes:
        pressure: (T, S) int64, or float64 if a cell is no whole number.
        channel_names: of the S sensors; none if the file names no column.
        time: (T,) seconds, by the unit in the column's name; None without such a column.
        labels: (T,) texts of each column of names, by `object`, `recording` and `session`.
        notes: what the columns hold that are no sensors.
    """

    file: Path
    pressure: np.ndarray
    channel_names: list[str]
    time: np.ndarray | None
    labels: dict[str, list[str]]
    notes: list[Note]

    def has_recordings(self, *, labelled: bool) -> bool:
        """Whether it may be the one table of all recordings: lines name objects, or if these need no name, parts."""
        restarts = self.time is not None and bool((np.diff(self.time) < 0).any())
        return "object" in self.labels or (not labelled and (restarts or "recording" in self.labels))

    def values(self, form: Form, index: Any = slice(None)) -> dict[str, np.ndarray]:
        """`pressure` (frames, rows, columns) and, if there is one, `time` of some lines."""
        pressure = framed(self.pressure[index], form, str(self.file))
        return {"pressure": pressure} if self.time is None else {"pressure": pressure, "time": self.time[index]}

    def recordings(self, form: Form) -> Iterator[Recording]:
        """The recordings in one table of all: the lines of one session, object and recording.

        Where no column names recordings, one begins where the object or the session changes, and where the time falls.
        """
        labels, frames = dict(self.labels), len(self.pressure)
        if "recording" not in labels:
            begins = np.arange(frames) == 0
            for texts in labels.values():
                begins[1:] |= np.array(texts[1:]) != np.array(texts[:-1])
            if self.time is not None:
                begins[1:] |= np.diff(self.time) < 0
            labels["recording"] = [str(number) for number in np.cumsum(begins)]
        kinds: list[str] = [kind for kind in ("session", "object", "recording") if kind in labels]
        lines = dict[tuple[str, ...], list[int]]()
        for line, key in enumerate(zip(*(labels[kind] for kind in kinds), strict=True)):
            lines.setdefault(key, []).append(line)
        for key, index in lines.items():
            names = dict(zip(kinds, key, strict=True)) | {"recording": "/".join(key)}
            yield Recording(names, self.values(form, index), self.channel_names, self.notes)


def read_table(file: Path, form: Form) -> Table:
    """The table in a text file, or in one that gzip has packed.

    Raises:
        UserError: there are no numbers, lines of unlike length, a cell without a number or a name, or no column of a
            name that the form gives.
    """
    import pandas as pd  # here, since it loads slowly

    text = _text(file)
    separator, above, rows = _top(file, text)
    decimal = "," if separator != "," and re.search(r"\d,\d", text) else "."
    # texts of pandas, since those of Arrow need more memory than the child process may take
    with warnings.catch_warnings(), pd.option_context("mode.string_storage", "python"):
        warnings.simplefilter("ignore", DeprecationWarning)  # pandas 3.1 rounds as float_precision asks for by itself
        try:
            cells = pd.read_csv(
                io.StringIO(NOT_NUMBERS.sub("", text)),
                sep=separator or r"\s+",
                decimal=decimal,
                header=None,
                skiprows=above,
                keep_default_na=False,
                na_values=[""],
                skipinitialspace=True,
                float_precision="round_trip",
                low_memory=False,
            )
        except pd.errors.ParserError as error:  # such as `Expected 2 fields in line 3, saw 4`
            raise UserError(
                f"{file}: {str(error).rpartition('error: ')[2].strip()}; correct or delete the line"
            ) from None
    width = 1 + max(np.flatnonzero(cells.notna().any()), default=-1)
    names = next((row[:width] for row in rows if len(row) >= width and not any(row[width:])), [""] * width)
    if missing := [name for name in form.columns.values() if name not in names]:
        raise UserError(f"{file}: no column {missing[0]!r}; found {listed(names)}")
    columns = [_numbers(cells[at], decimal) for at in range(width)]
    labels = _labels(names, form)
    sensors, notes, time = [], list[Note](), None
    for at, (name, values) in enumerate(zip(names, columns, strict=True)):
        kind = next((f"the name of the {label}" for label, column in labels.items() if column == at), "")
        kind = kind or ("time" if name == form.columns.get("time") else _kind(names, at, values))
        if not kind and name != form.columns.get("pressure", name):
            kind = "left out: `data.columns` names the column of the pressure"
        if kind == "time" and not time and not np.isnan(values).any():  # else of texts such as 12:30:01
            time = (at, next((UNITS[word] for word in _words(name) & UNITS.keys()), 1.0))
        if kind:
            notes.append(Note(f"column {at + 1}{f' ({name!r})' if name else ''} is {kind}", topic="columns"))
        else:
            sensors.append(at)
    for at in [*sensors, *labels.values()]:
        filled = cells[at].notna() if at in labels.values() else ~np.isnan(columns[at])
        if not filled.all():
            what = "a name" if at in labels.values() else "a number"
            raise UserError(
                f"{file}: frame {np.argmin(filled)}, column {at + 1} is not {what}; correct or delete the line"
            )
    return Table(
        file,
        np.column_stack([columns[at] for at in sensors]) if sensors else np.zeros((len(cells), 0)),
        [names[at][:MOST_LETTERS] for at in sensors] if any(names[at] for at in sensors) else [],
        columns[time[0]] * time[1] if time else None,
        {kind: [str(cell).strip() for cell in cells[at]] for kind, at in labels.items()},
        notes,
    )


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


def _top(file: Path, text: str) -> tuple[str | None, int, list[list[str]]]:
    """The separator of a table, None for blanks; the number of lines above its numbers; and the cells of these lines.

    A line above the numbers is a comment, or begins with a word and has words where the lines below have numbers.

    Raises:
        UserError: no line has numbers.
    """
    top = [(number, line) for number, line in enumerate(islice(io.StringIO(text), TOP)) if line.strip(EMPTY)]
    below = [line for _, line in top if not line.lstrip().startswith(COMMENT)][-3:]
    sample = max(below, key=lambda line: len(re.findall(r"(?<![\w.])[-+]?\d", line)), default="")
    separator = _separator(sample.strip())
    example, rows = _cells(sample, separator), list[list[str]]()
    for number, line in top:
        cells = _cells(line.lstrip("".join(COMMENT) + " "), separator)
        has_words = any(not _is_number(cell) and _is_number(other) for cell, other in zip(cells, example, strict=False))
        if not line.lstrip().startswith(COMMENT) and (_is_number(cells[0]) or not has_words):
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


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _numbers(cells: "Series", decimal: str) -> np.ndarray:
    """The cells of a column (T,) as int64 or float64, NaN where one is no number."""
    from pandas import to_numeric

    if cells.dtype.kind in NUMBERS:
        return cells.to_numpy()
    texts = [str(cell).replace(decimal, ".") for cell in cells]
    return to_numeric(np.array(texts, dtype=object), errors="coerce")


def _labels(names: list[str], form: Form) -> dict[str, int]:
    """The first column that names objects, recordings or sessions, by what it names."""
    words = {kind: {form.columns[kind].lower()} if kind in form.columns else known for kind, known in NAMES.items()}
    pairs = [(kind, at) for kind in words for at, name in enumerate(names) if name.lower() in words[kind]]
    return dict(reversed(pairs))


def _kind(names: list[str], at: int, values: np.ndarray) -> str:
    """What a column holds by its name and its values (T,): `time`, a line number, or "" for a sensor."""
    words, steps = _words(names[at]), np.diff(values)
    counts = len(steps) > 1 and np.median(steps) > 0 and (steps == np.median(steps)).mean() > MOSTLY
    is_index = at == 0 and not names[at] and any(names)  # of pandas
    if counts and (is_index or (words and words <= LINE_NUMBERS)):  # a finger is called `index` too
        return "the line's number"
    is_time = words & TIMES and words <= TIMES | ABOUT_TIMES
    is_sensor = words == {"t"} and not (names[at].lower() == "t" and (steps > 0).mean() > MOSTLY)  # temperature, thumb
    return "time" if is_time and not is_sensor else ""


def _words(name: str) -> set[str]:
    return set(re.findall(r"[a-zµ]+|#", name.lower()))
