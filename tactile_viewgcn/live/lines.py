"""Lines of numbers as frames: a line for each frame, a column for each sensor, perhaps the time.

A line of words above the numbers names the columns. The sensors of a model that knows their names
are then found by name, in any order. Without such a line the columns are the model's sensors.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tactile_viewgcn.live.source import LONGEST_LINE
from tactile_viewgcn.messages import UserError, listed, several
from tactile_viewgcn.readers.lines import CONTENTS, label_kind
from tactile_viewgcn.readers.source import Form, tidy
from tactile_viewgcn.readers.text import (
    COMMENT,
    MOST_SHOWN,
    NUMBER,
    SECONDS,
    base_and_unit,
    sensors_of_model,
    separator_of,
    split_line,
)

BYTE_ORDER_MARK = b"\xef\xbb\xbf"


class LineError(UserError):
    """A line that is no frame; the next one may be."""


class Frame(NamedTuple):
    """A frame as its line has it.

    Attributes:
        counts: float64 (H, W).
        time: in seconds; None where no column has it.
    """

    counts: np.ndarray
    time: float | None


class FrameLines:
    """Reads lines as the frames of a model.

    Args:
        shape: (H, W) of a frame.
        sensors: names of the model's sensors, row after row, or none.

    Attributes:
        notes: on the columns, since they were last taken.
    """

    def __init__(self, shape: tuple[int, int], sensors: Sequence[str]):
        self.notes = list[str]()
        self._shape = shape
        self._sensors = sensors
        self._width = shape[0] * shape[1]  # cells of a line
        self._columns = list(range(self._width))  # of the sensors, row after row
        self._time_column: int | None = None
        self._seconds = 1.0  # unit of the time
        self._separator: str | None = None  # of the cells; None for blanks
        self._is_first = True  # nothing was read so far
        self._header: list[str] = []
        # of the last line of words that names no sensor, and their separator
        self._unknown_names: list[str] = []
        self._unknown_separator: str | None = None

    def frame(self, line: bytes) -> Frame | None:
        """Return the frame of a line; None of an empty one, a comment, or one that names columns.

        Raises:
            LineError: the line is no frame.
            UserError: columns have names, but not those of the model's sensors.
        """
        if len(line) >= LONGEST_LINE:
            raise LineError(f"it has {len(line):,} bytes or more; expected a frame")
        if b"\0" in line:
            raise LineError("it is no text; expected numbers in UTF-8")
        if self._is_first:
            line = line.removeprefix(BYTE_ORDER_MARK)
        line = line.strip()
        if not line or line.startswith((b"#", b"%")):
            return None
        if self._is_first:
            self._separator = separator_of(line.decode("utf-8", "replace"))
        values = self._numbers(line)
        if values is not None:
            return self._frame_of(values)
        if self._names_columns(line.decode("utf-8", "replace")):
            return None
        raise LineError(self._fault(line))

    def _frame_of(self, values: list[float]) -> Frame | None:
        """Return the frame of a line's numbers; None if they number the columns."""
        are_named = len(self._unknown_names) == self._width
        if are_named and self._unknown_separator == self._separator:
            raise UserError(self._not_of_model(self._unknown_names))
        if self._is_first and values == list(range(self._width)):
            self.notes.append("0, 1, 2 and so on are numbers of columns, and no frame")
            return None
        self._is_first = False
        time = None
        if self._time_column is not None:
            time = values.pop() * self._seconds
            if not np.isfinite(time):
                raise LineError("the time is no finite number")
        return Frame(np.array(values).reshape(self._shape), time)

    def _cells(self, line: bytes) -> list[bytes]:
        """Return the cells of a line; a separator after the last one is no cell."""
        if self._separator != "," and b"," in line:
            line = line.replace(b",", b".")
        separator = None
        if self._separator:
            separator = self._separator.encode()
        cells = line.split(separator)
        if len(cells) == self._width + 1 and not cells[-1].strip():
            cells.pop()
        return cells

    def _numbers(self, line: bytes) -> list[float] | None:
        """Return the readings in the order of the sensors, then the time; None if that fails."""
        cells = self._cells(line)
        if len(cells) != self._width or b"_" in line:  # 1_000 is a number in Python only
            return None
        try:
            values = [float(cells[column]) for column in self._columns]
            if self._time_column is not None:
                values.append(float(cells[self._time_column]))
        except ValueError:
            return None
        return values

    def _fault(self, line: bytes) -> str:
        """Return what is wrong with a line."""
        cells = self._cells(line)
        if len(cells) != self._width:
            text = f"{several(len(cells), 'value')}; expected {self._width:,}"
            if len(cells) == self._width + 1 and not self._header:
                text += "; if one of them is the time, print a line that names the columns first"
            return text
        used = list(self._columns)
        if self._time_column is not None:
            used.append(self._time_column)
        for column in used:
            cell = cells[column].decode("utf-8", "replace").strip()
            if not NUMBER.fullmatch(cell):
                return f"column {column + 1} holds {cell[:MOST_SHOWN]!r}; expected a number"
        return "a cell holds no number"

    def _names_columns(self, line: str) -> bool:
        """Return whether a line names the columns; if so, they are taken by these names.

        Raises:
            LineError: they are more or fewer than the sensors of a model without names.
            UserError: they are not those of the model's sensors.
        """
        separator = separator_of(line)
        names = [tidy(cell) for cell in split_line(line.lstrip("".join(COMMENT)), separator)]
        if any(NUMBER.fullmatch(name) for name in names):
            return False
        if self._sensors and not set(names) & set(self._sensors):
            self._unknown_names = names
            self._unknown_separator = separator
            return False
        is_other_header = bool(self._header) and names != self._header
        if not self._sensors and (is_other_header or len(names) < len(self._columns)):
            return False
        self._is_first = False
        if names == self._header:
            self.notes.append("the names of the columns again: read on")
            return True
        kinds = [_content(name) for name in names]
        columns = self._sensor_columns(names, kinds)
        self._separator = separator
        self._unknown_names = []
        others = [column for column in range(len(names)) if column not in set(columns)]
        times = [column for column in others if kinds[column] == "time"]
        self._header = names
        self._width = len(names)
        self._columns = columns
        self._time_column = None
        if times:
            self._time_column = times[0]
            _, unit = base_and_unit(names[times[0]])
            self._seconds = SECONDS.get(unit, 1.0)
        left_out = [names[column] for column in others if column != self._time_column]
        if left_out:
            text = f"{several(len(left_out), 'column')} left out, no sensors of the model"
            self.notes.append(f"{text}: {listed(left_out)}")
        return True

    def _sensor_columns(self, names: list[str], kinds: list[str]) -> list[int]:
        """Return the columns of the model's sensors, row after row."""
        if self._sensors:
            found = sensors_of_model(names, Form(sensors=self._sensors), "the names of the columns")
            if not found:
                raise UserError(self._not_of_model(names))
            return [names.index(name) for name in found]
        columns = list(range(len(names)))
        if len(names) != len(self._columns):
            columns = [column for column in columns if not kinds[column]]
        if len(columns) != len(self._columns):
            count = several(len(columns), "sensor")
            raise LineError(
                f"names {count}: {listed(names)}; expected {len(self._columns)}, as the model has"
            )
        return columns

    def _not_of_model(self, names: list[str]) -> str:
        """Return that these names of the columns are not those of the model's sensors."""
        return (
            f"the columns are named {listed(names)}; expected the model's sensors among them, "
            f"each once: {listed(list(self._sensors))}"
        )


def _content(name: str) -> str:
    """Return what a column holds by its name, if it is no sensor; "" for readings."""
    base, _ = base_and_unit(name)
    return CONTENTS.get(base, "") or label_kind(name)
