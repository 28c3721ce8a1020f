"""Checks of recordings, view sets and rows that are given as arrays."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.source import MAX_PRESSURE, check_shape, storage_type

RECORDINGS, VIEW_SETS, ROWS = "recordings", "view sets", "rows"
FORMS = (
    "a list of recordings [(frames, rows, columns), ...] or [(frames, channels), ...], view sets (n, views, rows, "
    "columns), or rows (n, sensors); one recording is [recording], frames that are classified alone are "
    "frames[:, None], and an array (n, channels, frames) needs params={'data.shape': 'frames_last'}"
)


def form_of(X: Any, *, frames_last: bool = False) -> str:
    """The form of X: RECORDINGS for a list of them, VIEW_SETS for an array of four axes, else ROWS.

    An array of three axes is RECORDINGS with `frames_last`; else it may be a single recording, and is refused.

    Raises:
        UserError: ragged, or neither of one, two or four axes.
    """
    is_list = isinstance(X, list | tuple) or (isinstance(X, np.ndarray) and X.dtype == object and X.ndim == 1)
    if is_list and (not len(X) or any(_is_several(row) or _axes(row) in (2, 3) for row in X)):
        return RECORDINGS
    axes = _axes(X)
    if axes == 3 and frames_last:
        return RECORDINGS
    if axes not in (1, 2, 4):
        problem = "is ragged" if axes is None else f"is of type {type(X).__name__} with {axes} axes"
        raise UserError(f"X {problem}; expected {FORMS}")
    return VIEW_SETS if axes == 4 else ROWS


def recordings_by_row(X: Sequence[Any], *, frames_last: bool = False) -> list[Sequence[Any]]:
    """The recordings in each row of X, which is one recording or a list of several; a UserError for no rows.

    Channels (T, C) become frames of one row, (T, 1, C). With `frames_last` time is the last axis, not the first.
    """
    if not len(X):
        raise UserError("X holds no recordings; expected one or more, each an array (frames, rows, columns)")
    rows = [row if _is_several(row) else [row] for row in X]
    return [[_in_time(recording, frames_last) for recording in row] for row in rows]


def _in_time(recording: Any, frames_last: bool) -> Any:
    """A recording with its frames first; one of other than two or three axes, which is refused later, as it is."""
    axes = _axes(recording)
    if axes not in (2, 3):
        return recording
    array = np.moveaxis(np.asarray(recording), -1, 0) if frames_last else np.asarray(recording)
    return array[:, None] if axes == 2 else array


def _is_several(row: Any) -> bool:
    """Whether a row is a list of several recordings."""
    return isinstance(row, list | tuple) and len(row) > 0 and all(_axes(recording) == 3 for recording in row)


def _axes(values: Any) -> int | None:
    """Number of axes of an array or of nested lists; None where these are ragged."""
    try:
        return values.ndim if hasattr(values, "ndim") else np.asarray(values).ndim
    except ValueError:
        return None


def checked_arrays(rows: Sequence[Sequence[Any]]) -> tuple[list[np.ndarray], np.ndarray]:
    """All recordings as arrays (T_i, H, W) of one type that holds all their numbers, and the row of each recording.

    Raises:
        UserError: see `checked_array`; or a recording whose layout is not that of the first.
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

    Raises:
        UserError: begins with `name`; other axes or types, no frames, or values that the type cannot hold.
    """
    try:
        array = np.asarray(recording)
    except ValueError:
        raise UserError(f"{name} is ragged; expected frames of equal size, (frames, rows, columns)") from None
    check_shape(array.shape, name)
    check_finite(array, name)
    dtype = storage_type(array.dtype, name)
    if not len(array):
        raise UserError(f"{name} has no frames; expected one or more")
    if dtype.kind == "i" and (array.min() < np.iinfo(dtype).min or array.max() > np.iinfo(dtype).max):
        raise UserError(f"{name} holds counts from {array.min()} to {array.max()}; expected them in {dtype}")
    return array.astype(dtype, copy=False)


def check_finite(values: np.ndarray, where: str) -> None:
    """Raise a UserError that begins with `where` for values that are no numbers, not finite or too large."""
    if values.dtype.kind not in "iuf":
        raise UserError(f"{where} is of type {values.dtype}; expected integer counts or real numbers")
    unfit = np.argwhere(~(np.abs(values) <= np.float64(MAX_PRESSURE)))  # float16 has no such number
    if len(unfit):
        place = " in frame {}, row {}, column {}".format(*unfit[0]) if values.ndim == 3 else ""
        value = values[tuple(unfit[0])]
        raise UserError(f"{where} holds {value:g}{place}; expected a number up to {MAX_PRESSURE:g} from every sensor")
