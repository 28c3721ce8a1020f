"""Reads lines of numbers as frames, with a column for each sensor and perhaps one for the time.

A line of words above the numbers names the columns; it can begin with # or %. If the model knows
the names of its sensors, they are then found by name, in any order. Without such a line the columns
are the model's sensors.

A message of a logger can look like a line of names. Before the first frame, a line of names counts
only if the frames fit it. After the first frame, it counts only if it has the frames' separator.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tactile_viewgcn.live.source import LONGEST_LINE
from tactile_viewgcn.messages import UserError, listed, several
from tactile_viewgcn.readers.lines import COLUMN_NUMBERS, label_kind
from tactile_viewgcn.readers.source import Form, tidy
from tactile_viewgcn.readers.table_columns import (
    MOST_SHOWN,
    SECONDS,
    base_and_unit,
    content_by_name,
    sensors_of_model,
)
from tactile_viewgcn.readers.text import COMMENT, NUMBER, separator_of, split_line

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
MOST_HEADERS = 8  # lines of words before the first frame that can name its columns


class LineError(UserError):
    """A line is no frame; the next line can be a frame."""


class Frame(NamedTuple):
    """The frame of a line.

    Attributes:
        counts: float64 (H, W).
        time: in seconds; None if no column has the time.
    """

    counts: np.ndarray
    time: float | None


class Words(NamedTuple):
    """A line of words, which can name columns.

    Attributes:
        separator: between the cells; None for blanks.
        names: the cells.
    """

    separator: str | None
    names: list[str]


class Layout(NamedTuple):
    """Where a line has its readings and its time.

    Attributes:
        separator: between the cells; None for blanks.
        width: number of cells.
        columns: columns of the sensors, row after row.
        time_column: column of the time; None if there is none.
        seconds: unit of the time, in seconds.
        names: names of the columns; empty if no line names them.
    """

    separator: str | None
    width: int
    columns: list[int]
    time_column: int | None = None
    seconds: float = 1.0
    names: Sequence[str] = ()

    @property
    def used(self) -> list[int]:
        """Return the columns of the sensors, then the column of the time."""
        if self.time_column is None:
            return self.columns
        return [*self.columns, self.time_column]


class FrameLines:
    """Reads lines as the frames of a model.

    Args:
        shape: (H, W) of a frame.
        sensors: names of the model's sensors, row after row; empty if they have none.

    Attributes:
        notes: notes on the columns that were not printed yet.
    """

    def __init__(self, shape: tuple[int, int], sensors: Sequence[str]):
        self.notes = list[str]()
        self._shape = shape
        self._count = shape[0] * shape[1]  # of sensors
        self._sensors = sensors
        self._is_first = True  # whether no line was read so far
        self._has_frame = False  # whether a line of numbers was read
        self._layout = self._plain_layout(None)  # of the last line of numbers or names
        self._headers = deque[Layout](maxlen=MOST_HEADERS)  # layouts that the first frame can have
        # the last line of words that can name columns, but none of the model's sensors
        self._unknown: Words | None = None

    @property
    def expected(self) -> str:
        """Return in words what a line should hold."""
        return f"{several(self._count, 'number')}, one for each sensor of the model"

    def frame(self, line: bytes) -> Frame | None:
        """Return the frame of a line; None if it is empty, a comment, or names columns.

        Raises:
            LineError: the line is no frame.
            UserError: the columns have names, but the model's sensors have other names.
        """
        if len(line) >= LONGEST_LINE:
            raise LineError(f"it has {len(line):,} bytes or more; expected a frame")
        if b"\0" in line:
            raise LineError("it is no text; expected numbers in UTF-8")
        if self._is_first:
            line = line.removeprefix(BYTE_ORDER_MARK)
        self._is_first = False
        line = line.strip(b" \r\n")
        if not line.strip():
            return None
        if len(line.splitlines()) > 1:
            raise LineError("it has a carriage return in it; expected a newline after each frame")
        text = line.decode("utf-8", "replace")
        if text.lstrip().startswith(COMMENT):
            self._names_columns(text.lstrip("".join(COMMENT) + " "), is_comment=True)
            return None
        values = self._values(line)
        if values is not None:
            return self._frame_of(values)
        if self._names_columns(text, is_comment=False):
            return None
        raise LineError(self._fault(line))

    def _frame_of(self, values: list[float]) -> Frame | None:
        """Return the frame of a line's numbers; None if they number the columns."""
        layout = self._layout
        unknown = self._unknown
        if unknown and (unknown.separator, len(unknown.names)) == layout[:2]:
            raise UserError(self._not_of_model(unknown.names))
        is_at_top = not self._has_frame and not layout.names
        if is_at_top and values == list(range(self._count)):
            self.notes.append(COLUMN_NUMBERS)
            return None
        self._has_frame = True
        time = None
        if layout.time_column is not None:
            time = values.pop() * layout.seconds
            if not np.isfinite(time):
                raise LineError("the time is no finite number")
        return Frame(np.array(values).reshape(self._shape), time)

    def _plain_layout(self, separator: str | None) -> Layout:
        """Return the layout of lines without names: a column for each sensor and no other."""
        return Layout(separator, self._count, list(range(self._count)))

    def _values(self, line: bytes) -> list[float] | None:
        """Return the readings in the order of the sensors, then the time; None if that fails.

        The first line of numbers decides which line above it names the columns.
        """
        if not self._has_frame:
            plain = self._plain_layout(separator_of(line.strip().decode("utf-8", "replace")))
            layouts = list(self._headers)[::-1]
            are_elsewhere = all(layout.separator != plain.separator for layout in layouts)
            if not layouts:
                self._layout = plain
                layouts.append(plain)
            elif are_elsewhere and not self._sensors:  # the lines of words were messages
                layouts.append(plain)
        else:
            layouts = [self._layout]
        for layout in layouts:
            values = _numbers(line, layout)
            if values is not None:
                self._layout = layout
                return values
        return None

    def _fault(self, line: bytes) -> str:
        """Return what is wrong with a line."""
        layout = self._layout
        cells = _cells(line, layout)
        if len(cells) != layout.width:
            text = f"{several(len(cells), 'value')}; expected {layout.width:,}"
            if len(cells) == layout.width + 1 and not layout.names:
                text += "; if one of them is the time, print a line that names the columns first"
            return text
        for column in layout.used:
            cell = cells[column].decode("utf-8", "replace").strip()
            if not NUMBER.fullmatch(cell):
                return f"column {column + 1} holds {cell[:MOST_SHOWN]!r}; expected a number"
        return "a cell holds no number"

    def _names_columns(self, text: str, *, is_comment: bool) -> bool:
        """Return whether a line names the columns; if so, read the columns by these names.

        Args:
            text: text of the line, without the mark of a comment.
            is_comment: whether the line had such a mark. Then other words are no error.

        Raises:
            LineError: there are more or fewer names than sensors, in a model without names.
            UserError: the model's sensors have other names.
        """
        words = _words(text)
        if not any(words.names) or any(NUMBER.fullmatch(name) for name in words.names):
            return False
        if words.names == self._layout.names:
            self.notes.append("the names of the columns again: read on")
            return True
        if self._has_frame and words.separator != self._layout.separator:
            return False
        kinds = [_content(name) for name in words.names]
        if self._sensors:
            columns = self._columns_of_model(words, is_comment=is_comment)
        else:
            columns = self._columns_in_order(words, kinds, is_comment=is_comment)
        if columns is None:
            return False
        self._take(words, kinds, columns)
        return True

    def _take(self, words: Words, kinds: list[str], columns: list[int]) -> None:
        """Read the columns by these names from now on.

        Args:
            words: the names of the columns.
            kinds: what each column holds, see `_content`.
            columns: columns of the sensors.
        """
        names = words.names
        others = [column for column in range(len(names)) if column not in set(columns)]
        times = [column for column in others if kinds[column] == "time"]
        time_column = None
        seconds = 1.0
        if times:
            time_column = times[0]
            _, unit = base_and_unit(names[time_column])
            seconds = SECONDS.get(unit, 1.0)
        self._layout = Layout(words.separator, len(names), columns, time_column, seconds, names)
        self._headers.append(self._layout)
        self._unknown = None
        left_out = [names[column] or "no name" for column in others if column != time_column]
        if left_out:
            text = f"{several(len(left_out), 'column')} left out, no sensors of the model"
            self.notes.append(f"{text}: {listed(left_out)}")

    def _columns_of_model(self, words: Words, *, is_comment: bool) -> list[int] | None:
        """Return the columns of the model's sensors by their names; None if the words are no names.

        Raises:
            UserError: some of the sensors are named, and others are not.
        """
        names = words.names
        try:
            sensors = sensors_of_model(
                names, Form(sensors=self._sensors), "the names of the columns"
            )
            if sensors:
                return [names.index(name) for name in sensors]
            fault = UserError(self._not_of_model(names))
        except UserError as error:
            fault = error
        has_names = bool(self._layout.names)
        is_at_top = not self._has_frame and not has_names
        is_like_names = has_names and (words.separator, len(names)) == self._layout[:2]
        if not (is_at_top or is_like_names):
            return None
        names_sensors = not set(names).isdisjoint(self._sensors)
        if names_sensors and not is_comment:
            raise fault
        is_sentence = words.separator is None and (is_comment or self._has_frame)
        is_of_units = not self._has_frame and has_names
        if names_sensors or not (is_sentence or is_of_units):
            self._unknown = words
        return None

    def _columns_in_order(
        self, words: Words, kinds: list[str], *, is_comment: bool
    ) -> list[int] | None:
        """Return the columns of the sensors of a model without names; None if words name none.

        Raises:
            LineError: more or fewer sensors are named than the model has.
        """
        if self._has_frame or len(words.names) < self._count:
            return None
        columns = list(range(len(words.names)))
        if len(columns) == self._count:
            return columns
        if not words.names[0]:  # the number of the line, as pandas writes it
            columns.remove(0)
        named = columns
        columns = [column for column in named if not kinds[column]]
        if len(columns) < self._count:
            # `index` can be a finger, and not the number of the line
            columns = []
            for column in named:
                if not kinds[column] or words.names[column].lower() == "index":
                    columns.append(column)
        if len(columns) == self._count:
            return columns
        if is_comment:
            return None
        count = several(len(columns), "sensor")
        raise LineError(
            f"names {count}: {listed(words.names)}; expected {self._count}, as the model has"
        )

    def _not_of_model(self, names: list[str]) -> str:
        """Return the message that the model's sensors have other names than these columns."""
        return (
            f"the columns are named {listed(names)}; expected the model's sensors among them, "
            f"each once: {listed(list(self._sensors))}"
        )


def _cells(line: bytes, layout: Layout) -> list[bytes]:
    """Return the cells of a line; nothing is a cell after a separator at the end."""
    may_begin_empty = layout.names and layout.separator == "\t"
    if not may_begin_empty:
        line = line.strip()
    if layout.separator != "," and b"," in line:
        line = line.replace(b",", b".")
    separator = None
    if layout.separator:
        separator = layout.separator.encode()
    cells = line.split(separator)
    if len(cells) == layout.width + 1 and not cells[-1].strip():
        cells.pop()
    return cells


def _numbers(line: bytes, layout: Layout) -> list[float] | None:
    """Return the readings of a line in a layout, then the time; None if a cell is no number."""
    cells = _cells(line, layout)
    if len(cells) != layout.width or b"_" in line:  # 1_000 is a number in Python only
        return None
    try:
        return [float(cells[column]) for column in layout.used]
    except ValueError:
        return None


def _words(text: str) -> Words:
    """Return the words of a line; nothing is a word after a separator at the end."""
    separator = separator_of(text.strip())
    names = [tidy(cell) for cell in split_line(text, separator)]
    if len(names) > 1 and not names[-1]:
        names.pop()
    return Words(separator, names)


def _content(name: str) -> str:
    """Return what a column holds, by its name; "" if it holds readings."""
    return content_by_name(name) or label_kind(name)
