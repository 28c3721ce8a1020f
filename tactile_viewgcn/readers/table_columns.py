"""The columns of a table with a line for each frame: sensors, times, labels, or none of these."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
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
    label_text,
    setting,
)
from tactile_viewgcn.schema import nearest

if TYPE_CHECKING:
    from pandas import DataFrame, Series

NOT_OF_MODEL = "no sensor of the model"
MOST_SHOWN = 30  # letters of a cell in a message
SEARCHED_CELLS = 200  # of those that are no numbers, in which groups of digits are looked for
# of a time, at the end of a name such as time_ms or t [s]
UNIT = re.compile(r" ?[_(\[](s|ms|us|µs|ns)[)\]]?$")
# of a unit; else 1
SECONDS = {"ms": 1e-3, "millis": 1e-3, "us": 1e-6, "µs": 1e-6, "micros": 1e-6, "ns": 1e-9}
MOSTLY = 0.9  # of the steps of a counter, which may have lost lines or begun again


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
    for cell in cells[~filled].iloc[:SEARCHED_CELLS]:
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
