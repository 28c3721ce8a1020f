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
        UserError: None, a text, ragged, or an array with three axes or more than four.
    """
    listed = isinstance(values, list | tuple) or (
        isinstance(values, np.ndarray) and values.dtype == object and values.ndim == 1
    )
    if listed and (not len(values) or any(_axes(row) == 3 for row in values)):
        return RECORDINGS
    axes = _axes(values)
    if axes == 4:
        return VIEW_SETS
    if values is None or isinstance(values, str) or axes == 3 or axes > 4:
        kind = {type(None): "None", str: "a text"}.get(type(values), f"an array of {axes} axes")
        raise UserError(f"X is {kind}; expected {FORMS}")
    return ROWS


def _axes(values: Any) -> int:
    """Number of axes of an array, or of what NumPy makes one of."""
    try:
        return values.ndim if hasattr(values, "ndim") else np.asarray(values).ndim
    except ValueError:
        raise UserError(f"X is ragged; expected {FORMS}") from None


def checked_arrays(recordings: Sequence[Any], shape: tuple[int, int] | None = None) -> list[np.ndarray]:
    """Recordings as arrays (T_i, H, W) of one type, which holds the numbers of all of them.

    A UserError for none, for one that `checked_array` refuses, and for another layout than `shape` or the first one's.
    """
    if not len(recordings):
        raise UserError("X holds no recordings; expected one or more, each an array (frames, rows, columns)")
    arrays = [checked_array(recording, f"X[{number}]") for number, recording in enumerate(recordings)]
    of, expected = ("as in training", shape) if shape else ("as X[0]", arrays[0].shape[1:])
    for number, array in enumerate(arrays):
        if array.shape[1:] != expected:
            raise UserError(f"X[{number}] has frames of {_layout(array.shape[1:])}; expected {_layout(expected)}, {of}")
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
    if array.ndim != 3:
        raise UserError(f"{name} has shape {array.shape}; expected (frames, rows, columns)")
    check_shape(array.shape, name)
    if not len(array):
        raise UserError(f"{name} has no frames; expected one or more: leave it out")
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


def _layout(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))
