"""Define what readers return and what a user says about files, and check shapes and values."""

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from shlex import quote
from typing import Any

import numpy as np

from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.params import MAX_SIDE, SIDES
from tactile_viewgcn.schema import as_change

UNLABELLED = ""  # the name of an object that is still to be recognised
#: Names of the published sets, such as `test`, `training_set`, `x_train`, `dev`.
SIDE = re.compile(
    r"(?:[xs][ _-])?(?:(?P<train>train|training)|(?P<test>tests?|testing)"
    r"|(?P<validation>val|valid|validation|dev))(?:[ _-]?sets?)?"
)
BLOCK_FRAMES = 4096  # frames that are read or written at once
MAX_PRESSURE = 1e30  # absolute value, since the network's input is in single precision
MOST_SECONDS = 1e9  # absolute value of a time, thirty years
NUMBERS = "biuf"  # `kind` of the dtypes of numbers

#: The type of each column, which has a value for each frame. Every table has the first five.
COLUMNS = {
    "object": np.int16,  # index into objects
    "recording": np.int32,  # index into recordings
    "session": np.int16,  # index into sessions
    "frame": np.int32,  # frame number inside the recording
    "time": np.float64,  # seconds since the recording's first frame
    # index of the first recording that is held out together with this one, as for two hands
    "take": np.int32,
    "split": np.int8,  # code of the published set, see SIDES in params.py
    "valid": np.bool_,  # the object is held (STAG: hasValidLabel)
    "balanced": np.bool_,  # STAG's subset with equally many frames of each class (isBalanced)
    "grasp": np.int16,  # number of the grasp inside the recording (graspIndex)
    "grasp_valid": np.bool_,  # 4th to 6th second of a grasp (graspValid)
}
ATTRIBUTES_TOPIC = "attributes"  # the topic of notes on HDF5 attributes that are not used
MODEL_TOPIC = "sensors of the model"  # the topic of notes on columns that a model does not use
FRAMES_LAST = "frames_last"
LEAVE_OUT = "leave_out:"
WHERE_TO_SET = "(-S of `dvc exp run`, --set of `inspect` and `predict`)"


@dataclass(frozen=True)
class Form:
    """The settings by which a user says how files are read, as `data` of params.yaml has them.

    Attributes:
        shape: the rows and columns of a frame, or `FRAMES_LAST`. With `auto` arrays keep their
            shape.
        layout: the pattern of the files' paths, or `auto`, see `layout_of`.
        columns: the contents of columns, arrays or datasets, such as `pressure:emg` or
            `leave_out:note`.
        labelled: whether each recording must have an object. If not, the object of files that name
            none is `UNLABELLED`.
        sensors: the names of the sensors that a model knows, in its order. Tables that have all of
            them are read by these names, and their other columns are left out.
    """

    shape: str | Sequence[int] = "auto"
    layout: str = "auto"
    columns: Sequence[str] = ()
    labelled: bool = True
    sensors: Sequence[str] = ()

    @property
    def names(self) -> dict[str, str]:
        """The names in the files by their contents, as `columns` gives them."""
        names = dict[str, str]()
        for text in self.columns:
            if not text.startswith(LEAVE_OUT):
                kind, name = text.split(":", 1)
                names[kind] = name
        return names

    @property
    def left_out(self) -> list[str]:
        """The names in the files of the columns, arrays or datasets that are left out."""
        return [text.removeprefix(LEAVE_OUT) for text in self.columns if text.startswith(LEAVE_OUT)]


AUTO = Form()


@dataclass(frozen=True)
class Recording:
    """A recording as its file has it.

    Attributes:
        names: the names of the recording, its object, session, take and published set (`split`),
            if they stand in the file.
        values: `pressure` (T, H, W) and columns (T,). These are arrays, or datasets that are read
            when they are sliced. Times can begin at any value.
        channel_names: the names of the sensors, row after row. A sensor without a name has "". The
            list is empty if no sensor has a name.
        notes: how the file was read.
        dropped: the number of frames that were left out.
        left_out: the names in its file of the columns that `data.columns` leaves out.
        place: which recording of its file it is; "" if the file is one recording.
        is_framed: whether its pressure is (T, H, W) whatever a form says, as in STAG's files.
        labels: the texts (T,) by `session`, `object` and `recording`, if the lines of a table have
            them.
    """

    names: dict[str, str]
    values: dict[str, Any]
    channel_names: list[str] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    dropped: int = 0
    left_out: list[str] = field(default_factory=list)
    place: str = ""
    is_framed: bool = False
    labels: dict[str, Any] = field(default_factory=dict)


def tidy(name: str) -> str:
    """Return a name with composed letters (Unicode NFC), and without blanks at its ends."""
    return unicodedata.normalize("NFC", name).strip()


def label_text(value: Any) -> str:
    """Return a label as text; 1 and 1.0 both become 1."""
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    text = tidy(str(value))
    if re.fullmatch(r"[-+]?\d+\.0*", text):
        return text.partition(".")[0]
    return text


def side_of(name: str) -> int | None:
    """Return the code of the published set that a name means, see `SIDE`; None for other names."""
    match = SIDE.fullmatch(name.strip().lower())
    if match is None or match.lastgroup is None:
        return None
    return SIDES.index(match.lastgroup)


def setting(change: str) -> str:
    """Return for a message how to set a key of `data`."""
    return f"set '{change}' {WHERE_TO_SET}"


def columns_setting(*entries: str) -> str:
    """Return for a message how to set `data.columns`, whatever marks the names of columns have.

    Args:
        entries: such as `object:label`.
    """
    change = f"data.columns=[{','.join(entries)}]"
    if not all(re.fullmatch(r"\w+:[\w ./-]+", entry) for entry in entries):
        change = as_change("data.columns", list(entries))
    return f"set {quote(change)} {WHERE_TO_SET}"


def storage_type(dtype: np.dtype, where: str) -> np.dtype:
    """Return the type in which the table stores pressure.

    It is int16 or int32 for integers, and float32 or float64 for real numbers.

    Args:
        dtype: the type in the file.
        where: the beginning of the error.

    Raises:
        UserError: the type is no type of numbers.
    """
    if dtype.kind in "iu":
        fits_int16 = dtype.itemsize < 2 or dtype.newbyteorder("=") == np.int16
        return np.dtype(np.int16 if fits_int16 else np.int32)
    if dtype.kind == "f":
        return np.dtype(np.float32 if dtype.itemsize <= 4 else np.float64)
    raise UserError(
        f"{where}: pressure is of type {dtype}; expected integer counts or real numbers"
    )


def check_shape(shape: tuple[int, ...], where: str) -> tuple[int, int]:
    """Return (H, W) of pressure (T, H, W).

    Args:
        shape: the shape of the pressure.
        where: the beginning of the error.

    Raises:
        UserError: the pressure does not have three axes, or H or W is above `MAX_SIDE`.
    """
    if len(shape) != 3:
        raise UserError(f"{where}: pressure has shape {shape}; expected (frames, rows, columns)")
    _, rows, columns = shape
    if not (1 <= rows <= MAX_SIDE and 1 <= columns <= MAX_SIDE):
        raise UserError(
            f"{where}: frames of {rows} x {columns}; expected 1 x 1 to {MAX_SIDE} x {MAX_SIDE}; "
            f"if a line holds the rows of a frame, {setting('data.shape=[ROWS,COLUMNS]')}; "
            f"if the axes are (cells, frames), data.shape={FRAMES_LAST}"
        )
    return rows, columns


def check_values(values: dict[str, Any], where: str) -> tuple[tuple[int, int], np.dtype]:
    """Return the shape (H, W) of pressure (T, H, W) and the type in which the table stores it.

    Args:
        values: the pressure and the columns.
        where: the beginning of the error.

    Raises:
        UserError: the pressure has another shape or type, or a column is not (T,) or holds no
            numbers.
    """
    shape = check_shape(values["pressure"].shape, where)
    frames = values["pressure"].shape[:1]
    for name, column in values.items():
        if name == "pressure":
            continue
        if column.shape != frames or column.dtype.kind not in NUMBERS:
            what = f"shape {column.shape} and type {column.dtype}"
            raise UserError(
                f"{where}: {name} has {what}; expected {frames}, a number for each frame"
            )
    return shape, storage_type(values["pressure"].dtype, where)


def framed(values: Any, form: Form, where: str) -> Any:
    """Return an array or a dataset as frames (T, H, W), or as recordings (n, T, H, W).

    H and W can be one axis in the file. With a shape of [8, 6], arrays (n, T, 48) and (n, T, 8, 6)
    are n recordings of T frames. A dataset is read only if its axes must change.

    Args:
        values: the array or the dataset.
        form: gives the shape.
        where: the beginning of the error.

    Raises:
        UserError: the axes do not fit. The error says how they can be read, with the remedy.
    """
    axes = tuple(values.shape)
    if form.shape == "auto":
        _check_axes(axes, where)
        if len(axes) == 3:
            return values
        return _in_one_row(values[()])
    if form.shape == FRAMES_LAST:
        return _in_one_row(np.moveaxis(values[()], -1, 0))
    rows, columns = (int(side) for side in form.shape)
    if axes[1:] == (rows, columns):
        return values
    if axes == (rows, columns) or axes[1:] == (rows * columns,):
        return values[()].reshape(-1, rows, columns)
    is_stack_of_lines = len(axes) == 3 and axes[2] == rows * columns
    is_stack_of_grids = len(axes) == 4 and axes[2:] == (rows, columns)
    if is_stack_of_lines or is_stack_of_grids:
        return values[()].reshape(*axes[:2], rows, columns)
    expected = f"(frames, {rows}, {columns}) or (frames, {rows * columns})"
    remedy = "take recordings of one glove; if you set data.shape, set it back to auto"
    if len(axes) == 2 and axes[1] == rows * columns + 1:
        leave_out = setting("data.columns=[leave_out:COLUMN]")
        remedy += f"; if a column is no sensor, such as the time: in a table {leave_out}, by its "
        remedy += "name or its number from 1; in an array, cut it off before you save it"
    raise UserError(
        f"{where}: an array {axes}; expected {expected}, by data.shape or the model; {remedy}"
    )


def _check_axes(axes: tuple[int, ...], where: str) -> None:
    """Refuse an array that can be several recordings, if no shape decides it."""
    if len(axes) > 3:
        raise UserError(
            f"{where}: an array {axes}; expected (frames, rows, columns); {_as_stack(axes)}"
        )
    if len(axes) == 3 and max(axes[1:]) > MAX_SIDE:
        what = f"frames of {axes[1]} x {axes[2]}; expected 1 x 1 to {MAX_SIDE} x {MAX_SIDE}"
        last = setting(f"data.shape={FRAMES_LAST}")
        raise UserError(
            f"{where}: {what}; {_as_stack(axes)}; if the frames are the last axis, {last}"
        )


def _as_stack(axes: tuple[int, ...]) -> str:
    """Return the reading of an array (n, T, ...) as n recordings, with the remedy to type."""
    rows, columns = (1, *axes[2:])[-2:]
    what = f"if it holds {axes[0]:,} recordings of {axes[1]:,} frames of {rows} x {columns}"
    return f"{what}, {setting(f'data.shape=[{rows},{columns}]')}"


def _in_one_row(array: np.ndarray) -> np.ndarray:
    """Return channels (T, C) as frames (T, 1, C); other arrays stay as they are."""
    if array.ndim == 2:
        return array[:, None]
    return array


def stacked(recording: Recording, where: str) -> list[Recording]:
    """Return a recording, or the n recordings in pressure (n, T, H, W), at places 0 to n - 1.

    Args:
        recording: the recording.
        where: the beginning of the error.

    Raises:
        UserError: the pressure has other axes. Or it holds several recordings, but the times or
            flags of one.
    """
    pressure = recording.values["pressure"]
    if len(pressure.shape) != 4:
        check_shape(pressure.shape, where)
        return [recording]
    if len(recording.values) > 1:
        count = f"{len(pressure):,} recordings"
        raise UserError(f"{where}: {count} with times or flags of one; save each as its own file")
    recordings = list[Recording]()
    for number, frames in enumerate(pressure[()]):
        names = dict(recording.names)
        if "recording" in names:
            names["recording"] += f"/{number}"
        recordings.append(
            Recording(
                names,
                {"pressure": frames},
                recording.channel_names,
                recording.notes,
                recording.dropped,
                recording.left_out,
                place=str(number),
            )
        )
    return recordings


def limits(column: str, dtype: np.dtype) -> tuple[float, float]:
    """Return the smallest and the largest value that a column or the pressure can hold."""
    if dtype.kind == "b":
        return 0, 1
    if column == "time":
        return -MOST_SECONDS, MOST_SECONDS
    if dtype.kind == "f":
        return -MAX_PRESSURE, MAX_PRESSURE
    return np.iinfo(dtype).min, np.iinfo(dtype).max


def first_unfit(
    values: np.ndarray, low: float, high: float, *, is_whole: bool, may_be_nan: bool = False
) -> int | None:
    """Return the first index at which values (n, ...) are out of range; None if all are in range.

    Args:
        values: readings or a column.
        low: the smallest value, from `limits`.
        high: the largest value.
        is_whole: whether fractions are out of range too.
        may_be_nan: whether NaN is in range, as for an unknown time.
    """
    # float64, since 1e30 would be infinite in half precision
    smallest, largest = np.array([low, high], dtype=np.float64)
    inside = (values >= smallest) & (values <= largest)
    if is_whole:
        inside &= values == np.floor(values)
    if may_be_nan:
        inside |= np.isnan(values)
    if inside.all():
        return None
    return int(inside.reshape(len(values), -1).all(axis=1).argmin())
