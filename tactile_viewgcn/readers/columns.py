"""Telling the sensors in tables from times, line numbers, and names of objects, recordings and sessions."""

import re
from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.readers.source import FRAMES_LAST, Form, framed, listed
from tactile_viewgcn.readers.text import Table

UNITS = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"),
    "us": ("us", "µs", "micros", "microsecond", "microseconds"),
    "ns": ("ns", "nanos", "nanosecond", "nanoseconds"),
}
UNIT_OF = {word: unit for unit, words in UNITS.items() for word in words}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
#: Words in the names of columns. A name of a unit alone is that of a time, but for the short ones of a letter or two.
TIMES = {"time", "timestamp", "systime", "stamp", "tstamp", "elapsed", "clock", "millis", "micros", "ms", "t"}
ABOUT_TIMES = {"date", "sys", "system", "log", "unix", "epoch", "utc", "local", "since", "start"}
LINE_NUMBERS = {"sample", "samples", "frame", "frames", "row", "line", "packet", "index", "idx", "id", "seq"}
LINE_NUMBERS |= {"sequence", "n", "no", "nr", "num", "number", "count", "counter", "#"}
INDEX = {"", "unnamed: 0"}  # the first column of pandas' and R's tables
NAMES = {
    "object": {"object", "label", "class", "gesture", "target"},
    "recording": {"recording", "trial"},
    "session": {"session", "subject"},
}
MOST_LETTERS = 40  # of a name
MOSTLY = 0.9  # of the steps of a counter, which may have lost lines
LONGEST = 0.5  # seconds between frames, where a unit is guessed


@dataclass(frozen=True)
class Columns:
    """What the columns of tables hold.

    Attributes:
        names: of all columns.
        sensors: the columns of sensors.
        time: the column of times and its unit in seconds, if there is one with a known unit.
        notes: what the columns hold that are no sensors.
        is_shown: see `Table`.
        restarts: whether the time falls from a line to the next, as where another recording begins.
    """

    names: list[str]
    sensors: list[int]
    time: tuple[int, float] | None
    notes: list[Note]
    is_shown: bool
    restarts: bool

    @property
    def channel_names(self) -> list[str]:
        """Names of the sensors; none where the file may not be quoted, see `Table.is_shown`, or has none."""
        names = [self.names[at][:MOST_LETTERS] for at in self.sensors]
        return names if self.is_shown and any(names) else []


def named(names: list[str], form: Form) -> dict[str, int]:
    """The first column that names objects, recordings or sessions, by what it names."""
    words = {kind: {form.columns[kind].lower()} if kind in form.columns else known for kind, known in NAMES.items()}
    pairs = [(kind, at) for kind in words for at, name in enumerate(names) if name.lower() in words[kind]]
    return dict(reversed(pairs))


def starts(table: Table, form: Form) -> np.ndarray:
    """Bool (lines,): whether an object, a recording or a session begins with a line, by the columns that name them."""
    begins = np.arange(len(table.cells)) == 0
    for at in named(table.names, form).values():
        texts = table.cells[at].to_numpy(dtype=object)
        begins[1:] |= texts[1:] != texts[:-1]
    return begins


def columns_of(table: Table, form: Form) -> Columns:
    """What the columns of a table hold, and of all tables like it."""
    values = table.values(range(len(table.names)))
    with np.errstate(invalid="ignore"):  # of infinite readings
        steps = np.diff(values, axis=0)[~starts(table, form)[1:]]
    labels, sensors, notes, time = named(table.names, form), [], [], None
    for at, name in enumerate(table.names):
        kind = next((f"the name of the {label}" for label, column in labels.items() if column == at), "")
        kind = kind or (
            "time" if name == form.columns.get("time") else _kind(name, at, table.names, values[:, at], steps[:, at])
        )
        if kind == "time" and (unit := _unit(name, float(np.median(steps[:, at])) if len(steps) else 0.0)):
            time, kind = time or (at, SECONDS[unit]), f"time in {unit}"
        if kind == "time":
            kind = "time in no known unit; name it time_s or time_ms to keep the times"
        if kind:
            notes.append(Note(f"column {at + 1}{f' ({name!r})' if name else ''} is {kind}", topic="columns"))
        else:
            sensors.append(at)
    restarts = time is not None and bool((np.diff(values[:, time[0]]) < 0).any())
    return Columns(table.names, sensors, time, notes, table.is_shown, restarts)


def recordings_in(table: Table, columns: Columns, form: Form) -> list[tuple[dict[str, str], dict[str, np.ndarray]]]:
    """Names and values of the recordings in one table: the lines of one object, session and recording.

    Where no column names recordings, one begins where the object or the session changes, and where the time falls.

    Raises:
        UserError: a cell holds no number or no name.
    """
    values, texts = sensors_and_time(table, columns, form), dict[str, list[str]]()
    for kind, at in named(table.names, form).items():
        for row in np.flatnonzero(table.cells[at].isna())[:1]:
            where = f"line {table.line(row)}, column {at + 1}"
            raise UserError(f"{table.file}: {where} is empty; expected the name of the {kind} in each line")
        texts[kind] = [str(cell).strip() for cell in table.cells[at]]
    pressure = values["pressure"] = framed(values["pressure"], form, str(table.file))
    if form.shape == FRAMES_LAST or len(pressure) != len(table.cells):
        raise UserError(
            f"{table.file}: one table of all recordings has a frame in each line; expected data.shape of a frame"
        )
    if "recording" not in texts:
        begins = starts(table, form)
        begins[1:] |= np.diff(values.get("time", np.zeros(len(begins)))) < 0
        texts["recording"] = [str(number) for number in np.cumsum(begins)]
    kinds, lines = [kind for kind in ("session", "object", "recording") if kind in texts], dict[tuple, list[int]]()
    for line, key in enumerate(zip(*(texts[kind] for kind in kinds), strict=True)):
        lines.setdefault(key, []).append(line)
    return [
        (
            dict(zip(kinds, key, strict=True)) | {"recording": "/".join(key)},
            {name: column[index] for name, column in values.items()},
        )
        for key, index in lines.items()
    ]


def sensors_and_time(table: Table, columns: Columns | None, form: Form) -> dict[str, np.ndarray]:
    """`pressure` (lines, sensors) and, where its unit is known, `time` (lines,) in seconds.

    Raises:
        UserError: a cell holds no number, or the columns have other names than those of other tables.
    """
    columns = columns or columns_of(table, form)
    if any(table.names) and table.names != columns.names:
        names = f"columns {listed(table.names)}" if table.is_shown else "other columns"
        raise UserError(f"{table.file}: {names}; expected those of most files: {listed(columns.names)}")
    if len(columns.names) != len(table.names):  # refused with reasons later
        columns = columns_of(table, form)
    values = {"pressure": table.numbers(columns.sensors)}
    if columns.time:
        at, seconds = columns.time
        values["time"] = table.numbers([at])[:, 0] * seconds
    return values


def _kind(name: str, at: int, names: list[str], values: np.ndarray, steps: np.ndarray) -> str:
    """What a column holds by its name, its values and their steps (n,) from line to line; "" for a sensor."""
    words = _words(name)
    is_counting = len(steps) > 1 and np.median(steps) > 0 and (steps == np.median(steps)).mean() > MOSTLY
    is_counting &= at == 0 or values[0] in (0, 1)  # a finger is called `index` too
    if (words and words <= LINE_NUMBERS and is_counting) or (at == 0 and any(names) and name.lower() in INDEX):
        return "the line's number"
    is_time = words & TIMES and words <= TIMES | ABOUT_TIMES | UNIT_OF.keys()
    is_sensor = words == {"t"} and not (name.strip().lower() == "t" and (steps > 0).all())  # of temperature, of a thumb
    return "time" if is_time and not is_sensor else ""


def _words(name: str) -> set[str]:
    return set(re.findall(r"[a-zµ]+|#", name.lower()))


def _unit(name: str, step: float) -> str:
    """The unit of times, by their name, or by the median step from frame to frame; "" if it may be any."""
    for word in _words(name) & UNIT_OF.keys():
        return UNIT_OF[word]
    return next((unit for unit, seconds in SECONDS.items() if 0 < step * seconds < LONGEST and not 0.5 <= step < 2), "")
