"""Decide what each column of a table holds: a sensor's readings, times, labels or none of these.

The table has a line for each frame.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_viewgcn.messages import Note, UserError, listed
from tactile_viewgcn.readers.lines import CONTENTS, LABELS, label_kind
from tactile_viewgcn.readers.numerals import without_group_marks
from tactile_viewgcn.readers.source import (
    MAX_PRESSURE,
    MODEL_TOPIC,
    NUMBERS,
    Form,
    Recording,
    columns_setting,
    label_text,
)
from tactile_viewgcn.schema import nearest

if TYPE_CHECKING:
    from pandas import DataFrame, Series

NOT_OF_MODEL = "no sensor of the model"
MOST_SHOWN = 30  # letters of a cell that a message shows
SEARCHED_CELLS = 200  # cells without a number that are searched for groups of digits
# the unit of a time at the end of a name, such as time_ms or t [s]
UNIT = re.compile(r" ?[_(\[](s|ms|us|µs|ns)[)\]]?$")
# the seconds in a unit; any other unit counts as a second
SECONDS = {
    **dict.fromkeys(("s", "sec", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds"), 1e-3),
    # with the sign for micro, and with the Greek letter
    **dict.fromkeys(("us", "\u00b5s", "\u03bcs", "micros", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nanoseconds"), 1e-9),
    "min": 60.0,
}
# share of the steps in which a counter counts on; it may have lost lines or begun again
MOSTLY = 0.9


@dataclass
class _Table:
    """The contents of the columns of a table that have been looked at so far."""

    channels: list[str] = field(default_factory=list)
    readings: list[np.ndarray] = field(default_factory=list)
    time: np.ndarray | None = None
    labels: dict[str, Any] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)


def table_of(
    names: list[str],
    cells: "DataFrame",
    form: Form,
    file: str,
    places: Iterable[str],
    *,
    units: Sequence[str] = (),
    texts_of: Callable[[int], "Series"] | None = None,
) -> tuple[Recording, dict[str, Any]]:
    """Return a table of T lines as one recording, and its columns of labels.

    Args:
        names: the names of the columns. A column named "" goes by its number, counted from 1.
        cells: the cells. Its columns are numbered from 0.
        form: what the user says about the columns.
        file: the beginning of every error.
        places: the place of each row of `cells`, for errors.
        units: the units of the columns, if a line below the names holds them.
        texts_of: returns the cells of a column as they are written, by its number. Labels are taken
            from it, since `01` and `1.10` are no numbers there. None takes them from `cells`.

    Returns:
        The recording and its labels. The recording has pressure (T, S), the times if a column has
        them, and notes on the columns that are no sensors. The labels are a dict from `session`,
        `object` or `recording` to the T texts of that column.

    Raises:
        UserError: a cell lacks a number or a name. Or no column has a name that the form gives.
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
        unit = units[number] if number < len(units) else ""
        column = _Column(number, name, key, unit, cells[number], _numbers(cells[number]))
        content = _content_of(column, form, of_model, has_names=any(names))
        if key in of_model and content:
            what = f"column {number + 1} ({key!r}), a sensor of the model, is {content}"
            raise UserError(f"{file}: {what}; record it again")
        if content in LABELS and texts_of:
            column = replace(column, cells=texts_of(number))
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
        number: its number, counted from 0.
        name: its name; "" if it has none.
        key: its name, or else its number, counted from 1.
        unit: the cell of a line of units, such as `[ms]`; "" without such a line.
        cells: its cells as they stand in the table.
        values: (T,) its numbers, NaN where a cell is no number.
    """

    number: int
    name: str
    key: str
    unit: str
    cells: "Series"
    values: np.ndarray

    def __str__(self) -> str:
        text = f"column {self.number + 1}"
        if self.name:
            text += f" ({self.name!r})"
        return text


def _content_of(column: _Column, form: Form, of_model: list[str], *, has_names: bool) -> str:
    """Return the content of a column, or the reason why it is left out; "" for readings."""
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
        remedy = columns_setting(f"object:{column.key}")
        content += f"; if it names the objects of several recordings, {remedy}"
    return content


def _add_column(
    table: _Table, column: _Column, content: str, file: str, places: Iterable[str]
) -> None:
    """Add a column to a table; a column that is not a sensor gets a note."""
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
            table.time = column.values * _seconds_of(column)
    elif content == "time":
        example = str(column.cells[~filled].iloc[0])
        count = f"{np.sum(~filled)} of {len(filled)} cells are no number"
        content = f"time, not used: {count}, such as {example!r}"
    topic = MODEL_TOPIC if content.startswith(NOT_OF_MODEL) else "columns"
    text = f"{column} is not a sensor ({content})"
    table.notes.append(Note(text, topic=topic, value=column.number + 1))


def _seconds_of(column: _Column) -> float:
    """Return the seconds in the unit of a column of times, by its name or by a line of units."""
    _, unit = base_and_unit(column.name)
    if unit not in SECONDS:
        unit = column.unit.strip("[]() ").lower()
    return SECONDS.get(unit, 1.0)


def _labels_of(cells: "Series") -> Any:
    """Return the texts (T,) of a column as a categorical, which keeps equal texts once."""
    import pandas as pd  # here, since it loads slowly

    codes, values = pd.factorize(cells)
    texts = np.array([label_text(value) for value in values], dtype=object)
    numbers, unique = pd.factorize(texts)  # 1 and 1.0 are one label
    return pd.Categorical.from_codes(numbers[codes], categories=unique)


def sensors_of_model(keys: list[str], form: Form, file: str) -> list[str]:
    """Return the names of the columns that are sensors of the model, in the model's order.

    If a PART in the layout joins files, each file has only some of the sensors: the column `thumb`
    of the left hand's file is the sensor `left_thumb`. The names are then in the order of the
    columns, and a missing sensor is no error.

    Args:
        keys: the names of the columns.
        form: holds the names of the model's sensors.
        file: the beginning of every error.

    Returns:
        The names. There are none if no column has the name of a sensor, or if two sensors or two
        columns have one name.

    Raises:
        UserError: the layout has no PART, and only some of the model's sensors are there.
    """
    wanted = [*form.sensors]
    if "PART" in form.layout:
        parts = [name for name in keys if any(sensor.endswith(f"_{name}") for sensor in wanted)]
        return [name for name in dict.fromkeys(parts) if keys.count(name) == 1]
    found = [name for name in wanted if name in keys]
    # a sensor called "" has no name
    are_unlike = len(set(wanted)) == len(wanted) and "" not in wanted
    if not found or not are_unlike or any(keys.count(name) > 1 for name in found):
        return []
    left_out = [name for name in wanted if name in form.left_out]
    if left_out:
        remedy = "remove its leave_out from data.columns"
        raise UserError(f"{file}: {listed(left_out)} is a sensor of the model; {remedy}")
    missing = [name for name in wanted if name not in keys]
    if missing:
        what = f"no column {listed(missing)} of the model's sensors; found {listed(keys)}"
        raise UserError(f"{file}: {what}; rename the columns as in the training set")
    return found


def _unfit(
    file: str, column: _Column, filled: np.ndarray, content: str, places: Iterable[str]
) -> str:
    """Return the fault of a column of readings or of names, its place, and the remedy to type.

    Args:
        file: the beginning of every error.
        column: the column.
        filled: bool (T,), the cells that hold the value that is expected.
        content: what the column holds; "" for readings.
        places: the place of each row.
    """
    cells = column.cells
    values = column.values
    grouped = "" if content else _in_groups(file, cells, filled)
    if grouped:
        return f"{column}: {grouped}"
    row = int(np.argmin(filled))
    leave_out = columns_setting(f"leave_out:{column.key}")
    repeats = cells.nunique() < len(cells)
    if not content and np.isnan(values).all() and repeats and is_words(cells):
        example = str(cells.iloc[0])[:MOST_SHOWN]
        is_label = columns_setting(f"object:{column.key}")
        words = f"{column} holds words, such as {example!r}, and no number"
        return f"{words}; if it names the objects, {is_label}; else {leave_out}"
    fault = "is not a number"
    role = "is no sensor"
    if content:
        fault = "is not a name"
        role = "does not count"
    if cells.isna().iloc[row]:
        fault = "is empty"
    elif not content and not np.isnan(values[row]):
        fault = f"is not a number up to {MAX_PRESSURE:g}"
    place = next(islice(places, row, None))
    remedy = f"correct or delete the line, or, if the column {role}, {leave_out}"
    return f"{place}, {column} {fault}; {remedy}"


def _in_groups(file: str, cells: "Series", filled: np.ndarray) -> str:
    """Return the remedy for digits in groups, as in 1.012,5; "" if no cell has such groups.

    Only the first cells that are not `filled` are searched.
    """
    for cell in cells[~filled].iloc[:SEARCHED_CELLS]:
        command = without_group_marks(file, str(cell))
        if command:
            shown_cell = str(cell)[:MOST_SHOWN]
            what = f"{shown_cell!r} has marks between groups of digits"
            return f"{what}; to write it plainly: {command}"
    return ""


def is_words(cells: "Series") -> bool:
    """Return whether all cells are words: each begins with a letter, and digits can follow."""
    return all(re.fullmatch(r"[^\W\d_][\w .-]*", str(cell)) for cell in cells.unique())


def _content(name: str, values: np.ndarray, form: Form, *, is_index: bool) -> str:
    """Return the content of a column (T,), judged by its name; "" for readings.

    Args:
        name: the name of the column, or its number.
        values: (T,) its numbers.
        form: what the user says about the columns.
        is_index: whether it is the first column and has no name, while others have names.
    """
    for kind, column in form.names.items():
        if column == name:
            return "" if kind == "pressure" else kind
    last = _last_part(name)
    content = "line number"
    if not is_index:
        content = content_by_name(name)
    # labels are words or whole numbers
    if not content and (np.isnan(values).any() or (values == np.round(values)).all()):
        content = label_kind(name)
    steps = np.diff(values)
    is_counter = np.sum(steps == 1) > MOSTLY * len(steps)
    rises = np.sum(steps > 0) > MOSTLY * len(steps)
    # a column `index` that does not count is the index finger
    is_sensor_named_like_index = content == "line number" and not is_counter
    is_temperature = last.lower() == "t" and not rises
    if is_sensor_named_like_index or is_temperature:
        content = ""
    if (content or "pressure") in form.names:
        return "data.columns names other columns"
    return content


def content_by_name(name: str) -> str:
    """Return the content of a column that its name tells; "" for readings.

    Only the names in `CONTENTS` are known; `label_kind` knows labels by more words. Of a name with
    several parts the last one counts, so `.header.stamp.time` holds times.

    Args:
        name: the name of the column.

    Returns:
        A value of `CONTENTS`, or "".
    """
    base, _ = base_and_unit(_last_part(name))
    return CONTENTS.get(base, "")


def _last_part(name: str) -> str:
    """Return the last part of a name as ROS writes it: `seq` of `.header.seq`."""
    return re.split("[./]", name)[-1]


def base_and_unit(name: str) -> tuple[str, str]:
    """Return a name in lower case without its unit of time, and the unit.

    A name such as `millis` is both.

    Args:
        name: the name of a column.
    """
    base, *found = UNIT.split(name.lower())
    unit = found[0] if found else ""
    return base, unit or base


def _numbers(cells: "Series") -> np.ndarray:
    """Return the cells of a column as numbers (T,): integers, float64 or bool.

    A cell that is no number becomes NaN.

    A column of True and False stays bool. It becomes a sensor of ones and zeros, unless its name
    says that it holds something else.
    """
    from pandas import to_numeric

    if isinstance(cells.dtype, np.dtype) and cells.dtype.kind in NUMBERS:
        return np.asarray(cells.to_numpy())
    texts = np.array([str(cell).replace(",", ".") for cell in cells], dtype=object)
    return np.asarray(to_numeric(texts, errors="coerce"))
