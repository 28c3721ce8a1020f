"""What every reader returns, what a user says of the files, and the checks of shapes and values."""

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.params import MAX_SIDE, SIDES

UNLABELLED = ""  # stands for the name of an object that is to be recognised
#: Names of the published sets, such as `test`, `training_set`, `x_train`, `dev`.
SIDE = re.compile(
    r"(?:[xs][ _-])?(?:(?P<train>train|training)|(?P<test>tests?|testing)"
    r"|(?P<validation>val|valid|validation|dev))(?:[ _-]?sets?)?"
)
BLOCK_FRAMES = 4096  # frames that are read or written at once
MAX_PRESSURE = 1e30  # absolute value; the network's input is in single precision
MOST_SECONDS = 1e9  # absolute value of a time, thirty years
NUMBERS = "biuf"  # `kind` of the dtypes of numbers

#: Type of each column, one value for each frame. Every table has the first five.
COLUMNS = {
    "object": np.int16,  # index into objects
    "recording": np.int32,  # index into recordings
    "session": np.int16,  # index into sessions
    "frame": np.int32,  # frame number inside the recording
    "time": np.float64,  # seconds since the recording's first frame
    # index of the first of the recordings that belong together, as those of two hands do
    "take": np.int32,
    "split": np.int8,  # code of the published set, see SIDES in params.py
    "valid": np.bool_,  # the object is held (STAG: hasValidLabel)
    "balanced": np.bool_,  # STAG's subset of equally many frames a class (isBalanced)
    "grasp": np.int16,  # number of the grasp inside the recording (graspIndex)
    "grasp_valid": np.bool_,  # 4th to 6th second of a grasp (graspValid)
}
ATTRIBUTES_TOPIC = "attributes"  # of notes on attributes of HDF5 that say nothing
MODEL_TOPIC = "sensors of the model"  # of notes on columns that a model does without
FRAMES_LAST = "frames_last"
LEAVE_OUT = "leave_out:"


@dataclass(frozen=True)
class Form:
    """What the user says of files that leave it open, as `data` of params.yaml.

    Attributes:
        shape: rows and columns of a frame, `FRAMES_LAST`, or `auto`: as arrays have them.
        layout: pattern of the files' paths, or `auto`, see `layout_of`.
        columns: what columns, arrays or datasets of the files hold, such as `pressure:emg`,
            `leave_out:note`.
        labelled: False: files may name no object, and arrays may lie in no object's folder; their
            object is `UNLABELLED`.
        sensors: names of the sensors that a model knows, in its order. Tables that have all of
            them are read by these names, and their other columns are left out.
    """

    shape: str | Sequence[int] = "auto"
    layout: str = "auto"
    columns: Sequence[str] = ()
    labelled: bool = True
    sensors: Sequence[str] = ()

    @property
    def names(self) -> dict[str, str]:
        """Names in the files by what they hold, as `columns` has them."""
        names = dict[str, str]()
        for text in self.columns:
            if not text.startswith(LEAVE_OUT):
                kind, name = text.split(":", 1)
                names[kind] = name
        return names

    @property
    def left_out(self) -> list[str]:
        """Names in the files of the columns, arrays or datasets that are left out."""
        return [text.removeprefix(LEAVE_OUT) for text in self.columns if text.startswith(LEAVE_OUT)]


AUTO = Form()


@dataclass(frozen=True)
class Recording:
    """A recording as its file has it.

    Attributes:
        names: of the recording, its object, session, take and published set (`split`), as far as
            they stand in the file.
        values: `pressure` (T, H, W) and columns (T,): arrays, or datasets that are read when they
            are sliced. Times may begin at any value.
        channel_names: of the sensors, row after row; "" of one without a name, empty without any.
        notes: what was taken for what.
        dropped: number of frames that were left out.
        left_out: names in its file of the columns that `data.columns` leaves out.
        place: which recording of its file it is; "" where a file is one recording.
        is_framed: its pressure is (T, H, W) whatever a form says, as STAG's is.
        labels: texts (T,) by `session`, `object` and `recording`, of a table whose lines have them.
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
    """Return a name without blanks at its ends, its letters composed."""
    return unicodedata.normalize("NFC", name).strip()


def label_text(value: Any) -> str:
    """Return a label as text; 1 and 1.0 are one label, which is written as an integer."""
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    text = tidy(str(value))
    if re.fullmatch(r"[-+]?\d+\.0*", text):
        return text.partition(".")[0]
    return text


def side_of(name: str) -> int | None:
    """Return the code of the published set that a name means, see `SIDE`; None if it means none."""
    match = SIDE.fullmatch(name.strip().lower())
    if match is None or match.lastgroup is None:
        return None
    return SIDES.index(match.lastgroup)


def setting(change: str) -> str:
    """Return how to set a key of `data`, for a message."""
    return f"set '{change}' (-S of `dvc exp run`, --set of `inspect` and `predict`)"


def storage_type(dtype: np.dtype, where: str) -> np.dtype:
    """Return the type in which the table stores pressure.

    It is int16 or int32 for integers, float32 or float64 for real numbers.

    Raises:
        UserError: begins with `where`; these are no numbers.
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

    Raises:
        UserError: begins with `where`; other axes, or sides above `MAX_SIDE`.
    """
    if len(shape) != 3:
        raise UserError(f"{where}: pressure has shape {shape}; expected (frames, rows, columns)")
    _, rows, columns = shape
    if not (1 <= rows <= MAX_SIDE and 1 <= columns <= MAX_SIDE):
        raise UserError(
            f"{where}: frames of {rows} x {columns}; expected 1 x 1 to {MAX_SIDE} x {MAX_SIDE}; "
            f"of rows one after another {setting('data.shape=[ROWS,COLUMNS]')}; "
            f"of (cells, frames) data.shape={FRAMES_LAST}"
        )
    return rows, columns


def check_values(values: dict[str, Any], where: str) -> tuple[tuple[int, int], np.dtype]:
    """Return the shape (H, W) of pressure (T, H, W) and the type in which the table stores it.

    Raises:
        UserError: begins with `where`; pressure of another shape or type, or a column that is not
            (T,) or holds no numbers.
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

    Two axes may be one. With a shape of [8, 6], arrays (n, T, 48) and (n, T, 8, 6) are n recordings
    of T frames. A dataset is read only where its axes differ.

    Raises:
        UserError: begins with `where`; other axes, of which it says what they may be and what to
            type.
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
    remedy = f"{setting('data.shape=auto')}, or take recordings of one glove"
    raise UserError(
        f"{where}: an array {axes}; expected {expected}, by data.shape or as the model's; {remedy}"
    )


def _check_axes(axes: tuple[int, ...], where: str) -> None:
    """Refuse an array that may be several recordings, where no shape says what it is."""
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
    """Return what an array (n, T, ...) is, if it holds recordings, and what to type then."""
    rows, columns = (1, *axes[2:])[-2:]
    what = f"if it holds {axes[0]:,} recordings of {axes[1]:,} frames of {rows} x {columns}"
    return f"{what}, {setting(f'data.shape=[{rows},{columns}]')}"


def _in_one_row(array: np.ndarray) -> np.ndarray:
    """Return channels (T, C) as frames (T, 1, C); other arrays stay as they are."""
    if array.ndim == 2:
        return array[:, None]
    return array


def stacked(recording: Recording, where: str) -> list[Recording]:
    """Return a recording, or the n recordings of pressure (n, T, H, W), at places 0 to n - 1.

    Raises:
        UserError: begins with `where`; other axes, or several recordings with times of one.
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
    """Return the smallest and the largest value that a column or the pressure may hold."""
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
    """Return the first index at which values (n, ...) are out of range; None if all are in it.

    Args:
        values: readings or a column.
        low: the smallest value, from `limits`.
        high: the largest value.
        is_whole: fractions are out of range too.
        may_be_nan: NaN is in range, as for an unknown time.
    """
    # in half precision 1e30 would be infinite
    smallest, largest = np.array([low, high], dtype=np.float64)
    inside = (values >= smallest) & (values <= largest)
    if is_whole:
        inside &= values == np.floor(values)
    if may_be_nan:
        inside |= np.isnan(values)
    if inside.all():
        return None
    return int(inside.reshape(len(values), -1).all(axis=1).argmin())
