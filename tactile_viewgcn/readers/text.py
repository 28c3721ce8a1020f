"""Reading tables of numbers as text: a line for each frame, whose columns are sensors, times, line numbers and names.

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
from dataclasses import replace
from itertools import islice
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import numpy as np

from tactile_viewgcn.messages import Note, UserError, listed, several
from tactile_viewgcn.readers.child import UNPACKED, UNPACKED_TIMES, check_unpacked, library
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

TOP = 200  # lines in which the separator and the names are looked for
COMMENT = ("#", "%")
NUMBER = re.compile(r"(?i)[-+]?(\d+([.,]\d*)?|[.,]\d+)(e[-+]?\d+)?|[-+]?(nan|inf|infinity)")
NOT_NUMBERS = re.compile(r"^[ \t]*[#%].*$|^[ \t,;]+$", re.MULTILINE)  # comments and empty lines
#: What columns without readings hold, by their names in small letters.
CONTENTS = {
    **dict.fromkeys(("time", "timestamp", "t", "ms", "millis", "micros"), "time"),
    # if they count
    **dict.fromkeys(("sample", "frame", "index", "id", "seq", "counter"), "line number"),
    **dict.fromkeys(("object", "label", "class", "gesture", "target"), "object"),
    **dict.fromkeys(("recording", "trial"), "recording"),
    **dict.fromkeys(("session", "subject", "person", "participant"), "session"),
}
LABELS = ("session", "object", "recording")
# words of a label's name that say nothing more
OF_A_NAME = ("id", "name", "no", "nr", "num", "number", "code")
NOT_OF_MODEL = "no sensor of the model"
MOST_SHOWN = 30  # letters of a cell in a message
# of a time, at the end of a name such as time_ms or t [s]
UNIT = re.compile(r" ?[_(\[](s|ms|us|µs|ns)[)\]]?$")
# of a unit; else 1
SECONDS = {"ms": 1e-3, "millis": 1e-3, "us": 1e-6, "µs": 1e-6, "micros": 1e-6, "ns": 1e-9}
# of all lines, and the names in them, see `table_of`
Table = tuple[Recording, dict[str, np.ndarray]]
MOSTLY = 0.9  # of the steps of a counter, which may have lost lines or begun again


def read_table(file: Path, form: Form) -> Table:
    """The table in a text file, see `table_of`.

    A line of units below the names is left out, with a note: one with words, or one of ones where
    no other cell is 1.

    Raises:
        UserError: as `table_of`; there are no numbers, or lines of unlike length, or numbers that
            have two readings.
    """
    import pandas as pd  # here, since it loads slowly

    text = _text(file)
    check_is_table(file, text)
    separator, above, rows = _top(file, text)
    numbers = NOT_NUMBERS.sub("", text)
    check_numerals(file, numbers, separator, above)
    places = _places(numbers, above)
    # texts of pandas, since those of Arrow need more memory than the child process may take
    with (
        warnings.catch_warnings(),
        pd.option_context("mode.string_storage", "python"),
        library(file),
    ):
        # pandas 3.1 rounds as float_precision asks for by itself
        warnings.simplefilter("ignore", DeprecationWarning)
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
    # names of columns that are empty at the end
    if not full and rows and width < len(rows[-1]) <= cells.shape[1]:
        full, width = rows[-1:], len(rows[-1])
    is_ones = full and 1 < width == first.count("1") and len(cells) > 2
    if is_ones and (cells.iloc[:, :width] == 1).sum().eq(1).all():
        full, cells, _ = [*full, first], cells.iloc[1:], next(places)
    notes = [
        Note(f"the line {listed(row)} below the names is no frame (units)", topic="units")
        for row in full[1:]
    ]
    table, labels = table_of((full or [[""] * width])[0], cells, form, str(file), places)
    return replace(table, notes=notes + table.notes), labels


def _places(text: str, above: int) -> Iterator[str]:
    """`line N` of each row of a table below the first `above` lines, as an editor counts, with empty lines."""
    # a copy of the text, made where a cell is named, since it takes memory
    yield from (
        f"line {at}" for at, line in enumerate(io.StringIO(text), 1) if at > above and line != "\n"
    )


def table_of(
    names: list[str], cells: "DataFrame", form: Form, file: str, places: Iterable[str]
) -> Table:
    """A table as one recording, and the names in its lines.

    The recording has pressure (T, S), times if a column has them, and notes on the columns without
    readings. The names are by `session`, `object` and `recording` the texts (T,) of columns that
    have names of these.

    Args:
        names: of the columns, "" without one, which then goes by its number from 1; `cells` has
            numbers from 0.
        places: of each row of `cells`, for an error.

    Raises:
        UserError: begins with `file`; a cell without a number or a name, or no column of a name
            that the form gives.
    """
    keys = [name or str(number) for number, name in enumerate(names, 1)]
    for kind, name in form.names.items():
        if name not in keys and (form.labelled or kind not in LABELS):
            raise UserError(
                f"{file}: no column {name!r}{nearest(name, keys)}; found {listed(keys)}"
            )
    of_model = _sensors_of_model(keys, form, file)
    labels, time = dict[str, np.ndarray](), dict[str, np.ndarray]()
    sensors, channels, notes = [], [], list[Note]()
    for at, (name, key) in enumerate(zip(names, keys, strict=True)):
        values = _numbers(cells[at])
        content = (
            ""
            if key in of_model
            else _content(key, values, form, is_index=at == 0 and not name and any(names))
        )
        if of_model and not content and key not in of_model:
            content = NOT_OF_MODEL
            if is_words(cells[at]) and cells[at].nunique() > 1:
                content += f"; if it names the objects of several recordings, {setting(f'data.columns=[object:{key}]')}"
        if key in form.left_out or (cells[at].isna().all() and len(cells)):
            content = (
                "left out by data.columns"
                if key in form.left_out
                else f"empty in all {len(cells)} lines"
            )
        if key in of_model and content:
            raise UserError(
                f"{file}: column {at + 1} ({key!r}), a sensor of the model, is {content}; record it again"
            )
        filled = (
            cells[at].notna().to_numpy() if content in LABELS else np.abs(values) <= MAX_PRESSURE
        )
        column = f"column {at + 1}{f' ({name!r})' if name else ''}"
        if content in ("", *LABELS) and not filled.all():
            raise UserError(
                f"{file}: {_unfit(file, cells[at], values, filled, content, column, key, places)}"
            )
        if not content:
            sensors.append(values)
            channels.append(name)
            continue
        if content in LABELS:
            labels.setdefault(
                content, np.array([label_text(cell) for cell in cells[at]], dtype=object)
            )
        elif content == "time" and filled.all():
            time.setdefault("time", values * SECONDS.get(_base_and_unit(name)[1], 1.0))
        elif content == "time":
            example = str(cells[at][~filled].iloc[0])
            content = f"time, not used: {np.sum(~filled)} of {len(cells)} cells are no number, such as {example!r}"
        topic = MODEL_TOPIC if content.startswith(NOT_OF_MODEL) else "columns"
        notes.append(Note(f"{column} is no sensor ({content})", topic=topic, value=at + 1))
    if of_model:
        order = [channels.index(name) for name in of_model]
        sensors = [sensors[at] for at in order]
        channels = list(of_model)
    pressure = np.column_stack(sensors) if sensors else np.zeros((len(cells), 0))
    left_out = [key for key in keys if key in form.left_out]
    return Recording(
        {}, {"pressure": pressure} | time, channels if any(channels) else [], notes, 0, left_out
    ), labels


def _sensors_of_model(keys: list[str], form: Form, file: str) -> list[str]:
    """The sensors of the form among the columns, in the form's order; none where the columns have no names of these.

    Raises:
        UserError: some of the model's sensors are there and others are not.
    """
    wanted = [*form.sensors]
    if "PART" in form.layout:  # of left_thumb a file of the left hand has thumb
        parts = [name for name in keys if any(sensor.endswith(f"_{name}") for sensor in wanted)]
        return [name for name in dict.fromkeys(parts) if keys.count(name) == 1]
    found = [name for name in wanted if name in keys]
    are_unlike = len(set(wanted)) == len(wanted) and "" not in wanted  # "" has no name
    if not found or not are_unlike or any(keys.count(name) > 1 for name in found):
        return []
    left_out = [name for name in wanted if name in form.left_out]
    if left_out:
        raise UserError(
            f"{file}: {listed(left_out)} is a sensor of the model; take leave_out of it from data.columns"
        )
    missing = [name for name in wanted if name not in keys]
    if missing:
        what = f"no column {listed(missing)} of the model's sensors"
        raise UserError(
            f"{file}: {what}; found {listed(keys)}; rename the columns as in the training"
        )
    return found


def _unfit(
    file: str,
    cells: "Series",
    values: np.ndarray,
    filled: np.ndarray,
    content: str,
    column: str,
    key: str,
    places: Iterable[str],
) -> str:
    """What is wrong with a column that is no sensor and no names throughout, where, and what to type."""
    grouped = "" if content else _in_groups(file, cells, filled)
    if grouped:
        return f"{column}: {grouped}"
    row = int(np.argmin(filled))
    leave_out = setting(f"data.columns=[leave_out:{key}]")
    if not content and np.isnan(values).all() and cells.nunique() < len(cells) and is_words(cells):
        example = str(cells.iloc[0])[:MOST_SHOWN]
        is_label = setting(f"data.columns=[object:{key}]")
        words = f"{column} holds words, such as {example!r}, and no number"
        return f"{words}; if it names the objects, {is_label}; else {leave_out}"
    what = "a number"
    if content:
        what = "a name"
    elif not np.isnan(values[row]):
        what = f"a number up to {MAX_PRESSURE:g}"
    return f"{next(islice(places, row, None))}, {column} is not {what}; correct or delete the line, or {leave_out}"


def _in_groups(file: str, cells: "Series", filled: np.ndarray) -> str:
    """What to type where digits are in groups, as in 1.012,5; "" unless one of the first cells not `filled` is so."""
    for cell in cells[~filled].iloc[:TOP]:
        command = without_group_marks(file, str(cell))
        if command:
            return f"{str(cell)[:MOST_SHOWN]!r} has marks between groups of digits; to write it plainly: {command}"
    return ""


def is_words(cells: "Series") -> bool:
    """Whether all cells are words: letters, perhaps with digits after them."""
    return all(re.fullmatch(r"[^\W\d_][\w .-]*", str(cell)) for cell in cells.unique())


def recordings_in(table: Recording, labels: dict[str, np.ndarray], place: str) -> list[Recording]:
    """The recordings in one table of all, see `table_of`: the lines of one session, object and recording.

    Where no column names recordings, one begins where the object or the session changes, and where
    the time falls. Names begin with a place, if there is one; that of a recording alone is the
    place.
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
        names = dict(zip(keys, key, strict=True)) | {
            "recording": "/".join([*filter(None, [place]), *run])
        }
        values = {name: each[index] for name, each in table.values.items()}
        parts.append(replace(table, names=names, values=values, notes=notes))
    return parts


def label_kind(name: str) -> str:
    """`object`, `recording` or `session`, which a name says: label, Labels, class_label, subject_id; "" of others."""
    words = [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)]
    words = [re.sub(r"(?<=[^s])s$", "", word) for word in words if word not in OF_A_NAME] or words
    kinds = {CONTENTS.get(word, "") for word in words}
    return kinds.pop() if len(kinds) == 1 and kinds <= {*LABELS} else ""


def _content(name: str, values: np.ndarray, form: Form, *, is_index: bool) -> str:
    """What a column (T,) holds by its name: a value of `CONTENTS`, why it is left out, or "" for readings."""
    if kinds := [kind for kind, column in form.names.items() if column == name]:
        return kinds[0].replace("pressure", "")
    last = re.split("[./]", name)[-1]  # of a message of ROS, as .header.seq
    content = "line number" if is_index else CONTENTS.get(_base_and_unit(last)[0], "")
    # words, or whole numbers
    if not content and (np.isnan(values).any() or not (values % 1).any()):
        content = label_kind(name)
    steps = np.diff(values)
    counts, rises = (np.sum(each) > MOSTLY * len(steps) for each in (steps == 1, steps > 0))
    # a finger, a temperature
    if (content == "line number" and not counts) or (last.lower() == "t" and not rises):
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
    return to_numeric(
        np.array([str(cell).replace(",", ".") for cell in cells], dtype=object), errors="coerce"
    )


def _text(file: Path) -> str:
    """The text of a file, with a newline at the end of each line; a UserError for NUL, as in UTF-16 without a mark."""
    with file.open("rb") as stream:
        is_packed = stream.read(2) == b"\x1f\x8b"
    if is_packed:
        most = UNPACKED + UNPACKED_TIMES * file.stat().st_size
        with library(file), gzip.open(file) as packed:
            data = packed.read(most + 1)
        check_unpacked(file, len(data))
    else:
        data = file.read_bytes()
    try:
        is_utf16 = data[:2] in (b"\xff\xfe", b"\xfe\xff")
        text = data.decode("utf-16" if is_utf16 else "utf-8-sig")
    except UnicodeDecodeError:
        # of spreadsheets in western languages; no number is written differently
        text = data.decode("latin-1")
    if "\0" in text:
        raise UserError(f"{file}: no text; expected a table of numbers in UTF-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _top(file: Path, text: str) -> tuple[str | None, int, list[list[str]]]:
    """The separator of a table, None for blanks; the number of lines above its numbers; and the cells of these lines.

    A line above the numbers is a comment, or begins with a word and has words where the lines below
    have numbers.
    """
    top = [
        (number, line)
        for number, line in enumerate(islice(io.StringIO(text), TOP))
        if line.strip(" \t\n,;")
    ]
    below = [line for _, line in top if not line.lstrip().startswith(COMMENT)][-3:]
    sample = max(below, key=lambda line: len(re.findall(r"(?<![\w.])[-+]?\d", line)), default="")
    separator = _separator(sample.strip())
    example, rows = _cells(sample, separator), list[list[str]]()
    for number, line in top:
        cells = _cells(line.lstrip("".join(COMMENT) + " "), separator)
        pairs = [
            (NUMBER.fullmatch(cell), NUMBER.fullmatch(other))
            for cell, other in zip(cells, example, strict=False)
        ]
        has_words = any(is_number and not cell for cell, is_number in pairs)
        is_comment = line.lstrip().startswith(COMMENT)
        has_numbers_alone = any(cells) and all(NUMBER.fullmatch(cell) for cell in cells if cell)
        if (
            not is_comment
            and has_numbers_alone
            and not rows
            and _is_cut(cells, number, top, separator)
        ):
            lines = f"line {number + 1} has {several(len(cells), 'cell')}, the lines below have {len(example)}"
            raise UserError(
                f"{file}: {lines}, as one that is cut; delete it: sed -i.bak {number + 1}d {quote(str(file))}"
            )
        if not is_comment and pairs and (pairs[0][0] or not has_words):
            return separator, number, rows
        rows.append(cells)
    raise UserError(f"{file}: no line of numbers; expected a table of numbers")


def _is_cut(
    cells: list[str], number: int, top: list[tuple[int, str]], separator: str | None
) -> bool:
    """Whether a line of numbers is cut at its beginning: it has fewer cells than all lines below it, two at least.

    Or its first cell is empty, and the cells below that are no index of pandas, which has no name
    and counts.
    """
    below = [line for at, line in top if at > number and not line.lstrip().startswith(COMMENT)]
    rows = [_cells(line.strip(), separator) for line in below[:-1]]  # the last one may be cut too
    counts = {len(row) for row in rows}
    if len(counts) != 1 or len(cells) > min(counts):
        return False
    if cells[0]:
        return len(cells) < min(counts)
    first = [row[0] for row in rows]
    return first != [str(at) for at in range(len(first))]


def _separator(line: str) -> str | None:
    """The separator of the cells of a line, None for blanks.

    `1,5 2,5` has decimal commas. `1 501,1 498` has blanks between groups of digits, and commas
    between its cells.
    """
    cells = line.split(",")
    if len(cells) > 1 and all(re.fullmatch(GROUPED_BY_BLANKS, cell.strip()) for cell in cells):
        return ","
    words = line.split()
    is_decimal = len(words) > 1 and all(
        re.fullmatch(r"[-+\d]\d*,\d[\de+-]*", word) for word in words if "," in word
    )
    return next(
        (mark for mark in (";", "\t", ",") if mark in line and not (mark == "," and is_decimal)),
        None,
    )


def _cells(line: str, separator: str | None) -> list[str]:
    if not separator:
        cells = line.split()
    elif len(line) > csv.field_size_limit():
        cells = line.split(separator)
    else:
        cells = next(csv.reader([line], delimiter=separator), [])
    return [cell.strip().strip('"') for cell in cells]
