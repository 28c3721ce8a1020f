"""The form in which every reader returns recordings, and the checks of their shapes, types and values."""

import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.params import MAX_SIDE, TEST, TRAIN, VALIDATION

UNLABELLED = ""  # stands for the name of an object that is to be recognised
#: Names of its sides, such as `test`, `training_set`, `x_train`, `dev`.
SIDE = re.compile(
    r"(?:[xs][ _-])?(?:(train|training)|(tests?|testing)|(val|valid|validation|dev))(?:[ _-]?sets?)?"
)
BLOCK_FRAMES = 4096  # frames that are read or written at once
MAX_PRESSURE = 1e30  # absolute value; the network's input is in single precision
MOST_SECONDS = 1e9  # absolute value of a time, thirty years
NUMBERS = "biuf"  # `kind` of the dtypes of numbers

#: Type of each column, one value per frame. Every source has the first five.
COLUMNS = {
    "object": np.int16,  # index into objects
    "recording": np.int32,  # index into recordings
    "session": np.int16,  # index into sessions
    "frame": np.int32,  # frame number inside the recording
    "time": np.float64,  # seconds since the recording's first frame
    # index of the first of the recordings that belong together, as those of two hands do
    "take": np.int32,
    "split": np.int8,  # code of the published side, see SIDES in params.py
    "valid": np.bool_,  # the object is held (STAG: hasValidLabel)
    "balanced": np.bool_,  # STAG's subset of equally many frames a class (isBalanced)
    "grasp": np.int16,  # number of the grasp inside the recording (graspIndex)
    "grasp_valid": np.bool_,  # 4th to 6th second of a grasp (graspValid)
}
ATTRIBUTES_TOPIC = "attributes"  # of notes on attributes of HDF5 that say nothing
MODEL_TOPIC = "sensors of the model"  # of notes on columns that a model does without
FRAMES_LAST, LEAVE_OUT = "frames_last", "leave_out:"
Block = dict[str, np.ndarray]  # "pressure" (n, H, W) and columns (n,) of consecutive frames
# "pressure" (T, H, W) and columns (T,): arrays, or datasets that are read when sliced
Values = dict[str, Any]


@dataclass(frozen=True)
class Form:
    """What the user says of files that leave it open, as `data` of params.yaml.

    Attributes:
        shape: rows and columns of a frame, `FRAMES_LAST`, or `auto`: as arrays have them.
        layout: pattern of the files' paths, or `auto`, see `layout_of`.
        columns: what columns, arrays or datasets of the files hold, such as `pressure:emg`,
            `leave_out:note`.
        labelled: False: files may name no object, and arrays may lie in no object's folder; theirs
            is `UNLABELLED`.
        sensors: names of those that a model knows, in its order: tables that have all of them are
            read by these names, and their other columns are left out.
    """

    shape: str | Sequence[int] = "auto"
    layout: str = "auto"
    columns: Sequence[str] = ()
    labelled: bool = True
    sensors: Sequence[str] = ()

    @property
    def names(self) -> dict[str, str]:
        """Names in the files by what they hold, of `columns`."""
        return dict(text.split(":", 1) for text in self.columns if not text.startswith(LEAVE_OUT))

    @property
    def left_out(self) -> list[str]:
        """Names in the files of what is left out."""
        return [text.removeprefix(LEAVE_OUT) for text in self.columns if text.startswith(LEAVE_OUT)]


AUTO = Form()


@dataclass(frozen=True)
class Recording:
    """What a file says of its recording.

    Attributes:
        names: of the recording, and of its object and session where the file names them.
        values: pressure and columns; times may begin at any value.
        channel_names: see `Source`.
        notes: what was taken for what.
        dropped: number of frames that were left out.
        left_out: names in its files of what `data.columns` leaves out.
    """

    names: dict[str, str]
    values: Values
    channel_names: list[str] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    dropped: int = 0
    left_out: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Source:
    """Recordings as a reader describes them, and their frames in blocks.

    Attributes:
        names: of objects, recordings and sessions, by the column that holds their indices.
        shape: (H, W) of a frame.
        dtype: type in which the table stores the pressure.
        frames: number of all frames.
        blocks: the frames in the file's order; can be iterated once.
        notes: what was taken for what, and what was left out.
        channel_names: names of the sensors, row after row; "" of one without a name, empty without
            any.
    """

    path: Path
    names: dict[str, list[str]]
    shape: tuple[int, int]
    dtype: np.dtype
    frames: int
    blocks: Iterator[Block]
    notes: list[Note] = field(default_factory=list)
    channel_names: list[str] = field(default_factory=list)


def tidy(name: str) -> str:
    """A name without blanks at its ends, its letters composed."""
    return unicodedata.normalize("NFC", name).strip()


def label_text(value: Any) -> str:
    """A label as text; a whole number is written as an integer, since 1 and 1.0 are one label."""
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    text = tidy(str(value))
    return text.partition(".")[0] if re.fullmatch(r"[-+]?\d+\.0*", text) else text


def side_of(name: str) -> int | None:
    """Code of the published side that a name means, see `SIDE`; capitals do not matter. None: it names none."""
    match = SIDE.fullmatch(name.strip().lower())
    return (TRAIN, TEST, VALIDATION)[int(match.lastindex or 1) - 1] if match else None


def storage_type(dtype: np.dtype, where: str) -> np.dtype:
    """Type in which the table stores pressure: int16 or int32 for integers, float32 or float64 for real numbers."""
    if dtype.kind in "iu":
        return np.dtype(
            np.int16 if dtype.itemsize < 2 or dtype.newbyteorder("=") == np.int16 else np.int32
        )
    if dtype.kind == "f":
        return np.dtype(np.float32 if dtype.itemsize <= 4 else np.float64)
    raise UserError(
        f"{where}: pressure is of type {dtype}; expected integer counts or real numbers"
    )


def check_shape(shape: tuple[int, ...], where: str) -> tuple[int, int]:
    """(H, W) of pressure (T, H, W); a UserError that begins with `where` for other axes, or sides above `MAX_SIDE`."""
    if len(shape) != 3:
        raise UserError(f"{where}: pressure has shape {shape}; expected (frames, rows, columns)")
    if not all(1 <= side <= MAX_SIDE for side in shape[1:]):
        raise UserError(
            f"{where}: frames of {shape[1]} x {shape[2]}; expected 1 x 1 to {MAX_SIDE} x {MAX_SIDE}; of rows one after "
            f"another {setting('data.shape=[ROWS,COLUMNS]')}; of (cells, frames) data.shape={FRAMES_LAST}"
        )
    return shape[1], shape[2]


def framed(values: Any, form: Form, where: str) -> Any:
    """An array or a dataset as frames (T, H, W), or with an axis more by the form's shape as recordings (n, T, H, W).

    Two axes may be one. With a shape of [8, 6], arrays (n, T, 48) and (n, T, 8, 6) are n recordings
    of T frames. A dataset is read only where its axes differ.

    Raises:
        UserError: begins with `where`; other axes, of which it says what they may be and what to
            type.
    """
    axes = tuple(values.shape)
    if form.shape == "auto":
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
        if len(axes) == 3:
            return values
    elif not isinstance(form.shape, str) and axes[1:] == tuple(form.shape):
        return values
    array = values[()]
    if form.shape == FRAMES_LAST:
        array = np.moveaxis(array, -1, 0)
    elif not isinstance(form.shape, str):
        rows, columns = form.shape
        if axes == (rows, columns) or axes[1:] == (rows * columns,):
            return array.reshape(-1, rows, columns)
        if (len(axes) == 3 and axes[2] == rows * columns) or (
            len(axes) == 4 and axes[2:] == (rows, columns)
        ):
            return array.reshape(*axes[:2], rows, columns)
        expected = f"(frames, {rows}, {columns}) or (frames, {rows * columns}), by data.shape or as the model's"
        remedy = f"{setting('data.shape=auto')}, or take recordings of one glove"
        raise UserError(f"{where}: an array {axes}; expected {expected}; {remedy}")
    return array[:, None] if array.ndim == 2 else array


def _as_stack(axes: tuple[int, ...]) -> str:
    """What an array (n, T, ...) is, if it holds recordings, and what to type then."""
    sides = (1, *axes[2:])[-2:]
    what = f"if it holds {axes[0]:,} recordings of {axes[1]:,} frames of {sides[0]} x {sides[1]}"
    return f"{what}, {setting(f'data.shape=[{sides[0]},{sides[1]}]')}"


def setting(change: str) -> str:
    """How to set a key of `data`, for a message."""
    return f"set '{change}' (-S of `dvc exp run`, --set of `inspect` and `predict`)"


def sliced(values: Values, frames: int) -> Iterator[Block]:
    """Pressure and columns in blocks; without a column of frames these are numbered, without one of times it is NaN."""
    values = {"frame": np.arange(frames), "time": np.full(frames, np.nan)} | values
    for start in range(0, frames, BLOCK_FRAMES):
        yield {name: column[start : start + BLOCK_FRAMES] for name, column in values.items()}


def check_column(column: str, values: np.ndarray, block: Block, source: Source) -> None:
    """Raise a UserError that names the first id, column value or reading of a block that is out of range."""
    kind = source.dtype if column == "pressure" else np.dtype(COLUMNS[column])
    if column == "pressure" and kind.kind == "i" and np.can_cast(values.dtype, kind):
        return
    most = {"f": MOST_SECONDS if column == "time" else MAX_PRESSURE, "b": 1}.get(
        kind.kind
    ) or np.iinfo(kind).max
    low = {"f": -most, "b": 0}.get(kind.kind, -most - 1)
    if column in source.names:
        low, most = 0, min(most, len(source.names[column]) - 1)
    low, high = np.array([low, most], dtype=np.float64)  # in half precision 1e30 would be infinite
    inside = (
        (values >= low) & (values <= high) & ((values == np.floor(values)) | (kind.kind == "f"))
    )
    inside |= np.isnan(values) & (column == "time")  # an unknown time
    if inside.all():
        return
    at = int(inside.reshape(len(values), -1).all(axis=1).argmin())
    number, value = block["recording"][at], np.extract(~inside[at], values[at])[0]
    name = dict(enumerate(source.names["recording"])).get(number)
    remedy = "; leave out frames without readings, or mark them in HDF5 as not held by `valid`"
    raise UserError(
        f"{source.path}: {column} of frame {block['frame'][at]}{f' of recording {name}' if name else ''} is "
        f"{value:.10g}; expected {'real' if kind.kind == 'f' else 'whole'} numbers from {low:.10g} to {high:.10g}"
        f"{remedy if np.isnan(value) else ''}"
    )
