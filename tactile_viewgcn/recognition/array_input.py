"""What recordings, view sets or rows that are given as arrays have to be."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.source import MAX_PRESSURE, check_shape, storage_type

RECORDINGS, VIEW_SETS, ROWS = "recordings", "view sets", "rows"
FORMS = (
    "a list of recordings [(frames, rows, columns), ...], view sets (n, views, rows, columns), or rows (n, sensors); "
    "one recording is [recording], and frames that are classified alone are frames[:, None]"
)


def form_of(values: Any) -> str:
    """Which of the three forms X has: a list of recordings, an array of view sets, or else rows.

    Raises:
        UserError: ragged, or neither of one, two or four axes.
    """
    listed = isinstance(values, list | tuple) or (
        isinstance(values, np.ndarray) and values.dtype == object and values.ndim == 1
    )
    try:
        if listed and (not len(values) or any(_holds_recordings(row) or _axes(row) == 3 for row in values)):
            return RECORDINGS
        axes = _axes(values)
    except ValueError:
        raise UserError(f"X is ragged; expected {FORMS}") from None
    if axes not in (1, 2, 4):
        raise UserError(f"X is of type {type(values).__name__} with {axes} axes; expected {FORMS}")
    return VIEW_SETS if axes == 4 else ROWS


def recordings_of_rows(rows: Sequence[Any]) -> tuple[list[Any], np.ndarray]:
    """The recordings of rows that are one or a list of several each, and the row int64 (n,) of each recording."""
    several = [row if _holds_recordings(row) else [row] for row in rows]
    counts = [len(row) for row in several]
    return [recording for row in several for recording in row], np.repeat(np.arange(len(several)), counts)


def _holds_recordings(row: Any) -> bool:
    """Whether a row is a list of recordings; one that is ragged is none."""
    try:
        return isinstance(row, list | tuple) and len(row) > 0 and all(_axes(recording) == 3 for recording in row)
    except ValueError:
        return False


def _axes(values: Any) -> int:
    """Number of axes of an array, or of what NumPy makes one of."""
    return values.ndim if hasattr(values, "ndim") else np.asarray(values).ndim


def checked_arrays(
    recordings: Sequence[Any], shape: tuple[int, int] | None = None, rows: Sequence[int] | None = None
) -> list[np.ndarray]:
    """Recordings as arrays (T_i, H, W) of one type, which holds the numbers of all of them; `rows` of X are named.

    A UserError for none, for one that `checked_array` refuses, and for another layout than `shape` or the first one's.
    """
    if not len(recordings):
        raise UserError("X holds no recordings; expected one or more, each an array (frames, rows, columns)")
    rows = range(len(recordings)) if rows is None else rows
    arrays = [checked_array(recording, f"X[{row}]") for recording, row in zip(recordings, rows, strict=True)]
    expected = shape or arrays[0].shape[1:]
    for number, array in zip(rows, arrays, strict=True):
        if array.shape[1:] != expected:
            layouts = (" x ".join(map(str, each)) for each in (array.shape[1:], expected))
            of = "in training" if shape else "X[0]"
            raise UserError("X[{}] has frames of {}; expected {}, as {}".format(number, *layouts, of))
    dtype = np.result_type(*arrays)
    return [array.astype(dtype, copy=False) for array in arrays]


def checked_array(recording: Any, name: str) -> np.ndarray:
    """One recording as an array (T, H, W) of the type in which pressure is stored.

    A UserError, whose message begins with `name`, for other axes or types, no frames, and values that do not fit.
    """
    try:
        array = np.asarray(recording)
    except ValueError:
        raise UserError(f"{name} is ragged; expected frames of equal size, (frames, rows, columns)") from None
    if array.ndim != 3 or not len(array):
        raise UserError(f"{name} has shape {array.shape}; expected (frames, rows, columns), one frame or more")
    check_shape(array.shape, name)
    check_finite(array, name)
    dtype = storage_type(array.dtype, name)
    if dtype.kind == "i" and (array.min() < np.iinfo(dtype).min or array.max() > np.iinfo(dtype).max):
        raise UserError(f"{name} holds counts from {array.min()} to {array.max()}; expected them in {dtype}")
    return array.astype(dtype, copy=False)


def check_finite(values: np.ndarray, where: str) -> None:
    """Raise a UserError, whose message begins with `where`, for values that are no numbers, not finite or too large."""
    if values.dtype.kind not in "iuf":
        raise UserError(f"{where} is of type {values.dtype}; expected integer counts or real numbers")
    unfit = np.argwhere(~(np.abs(values) <= np.float64(MAX_PRESSURE)))  # float16 has no such number
    if len(unfit):
        place = " in frame {}, row {}, column {}".format(*unfit[0]) if values.ndim == 3 else ""
        value = values[tuple(unfit[0])]
        raise UserError(f"{where} holds {value:g}{place}; expected a number up to {MAX_PRESSURE:g} from every sensor")
