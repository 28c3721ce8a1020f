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
        if listed and (not len(values) or any(_holds_recordings(row) or np.ndim(row) == 3 for row in values)):
            return RECORDINGS
        axes = values.ndim if hasattr(values, "ndim") else np.asarray(values).ndim
    except ValueError:
        raise UserError(f"X is ragged; expected {FORMS}") from None
    if axes not in (1, 2, 4):
        raise UserError(f"X is of type {type(values).__name__} with {axes} axes; expected {FORMS}")
    return VIEW_SETS if axes == 4 else ROWS


def recordings_by_row(X: Sequence[Any]) -> list[Sequence[Any]]:
    """The recordings in each row of X, which is one or a list of several; a UserError for none."""
    if not len(X):
        raise UserError("X holds no recordings; expected one or more, each an array (frames, rows, columns)")
    return [row if _holds_recordings(row) else [row] for row in X]


def _holds_recordings(row: Any) -> bool:
    """Whether a row is a list of recordings; one that is ragged is none."""
    try:
        return isinstance(row, list | tuple) and len(row) > 0 and all(np.ndim(recording) == 3 for recording in row)
    except ValueError:
        return False


def checked_arrays(rows: Sequence[Sequence[Any]]) -> tuple[list[np.ndarray], np.ndarray]:
    """All recordings as arrays (T_i, H, W) of one type, which holds the numbers of all of them, and the row of each.

    A UserError for one that `checked_array` refuses, and for another layout than the first one's.
    """
    row = np.repeat(np.arange(len(rows)), [len(recordings) for recordings in rows])
    arrays = [checked_array(each, f"X[{number}]") for number, recordings in enumerate(rows) for each in recordings]
    for number, array in zip(row, arrays, strict=True):
        if array.shape[1:] != arrays[0].shape[1:]:
            layout, expected = (" x ".join(map(str, each.shape[1:])) for each in (array, arrays[0]))
            raise UserError(f"X[{number}] has frames of {layout}; expected {expected}, as X[0]")
    dtype = np.result_type(*arrays)
    return [array.astype(dtype, copy=False) for array in arrays], row


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
