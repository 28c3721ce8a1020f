"""Make the columns of all frames of a source, from names and from the contents of the files."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tactile_viewgcn.params import SIDES
from tactile_viewgcn.readers.naming import Named, takes_of
from tactile_viewgcn.readers.source import COLUMNS, first_unfit, limits
from tactile_viewgcn.tables.writing import Fault

UNREAD = "; leave out frames without readings, or mark them in HDF5 as not held by `valid`"


def columns_of(
    recordings: Sequence[Named], ids: Mapping[str, Sequence[str]], frames: int
) -> dict[str, np.ndarray]:
    """Return the columns (T,) of all frames, in the order in which they were written.

    Args:
        recordings: the recordings with their names.
        ids: the names of objects, recordings and sessions in the order of their numbers.
        frames: the number of all frames.
    """
    columns = dict[str, np.ndarray]()
    for kind in ids:
        columns[kind] = np.zeros(frames, dtype=np.int32)
    columns["frame"] = np.zeros(frames)
    columns["time"] = np.full(frames, np.nan)
    numbers = dict[str, dict[str, int]]()
    for kind, names in ids.items():
        numbers[kind] = {name: number for number, name in enumerate(names)}
    for recording in recordings:
        for kind, number_of in numbers.items():
            columns[kind][recording.lines] = number_of[recording.names[kind]]
        columns["frame"][recording.lines] = np.arange(recording.frames)
    _add_from_files(columns, recordings, frames)
    for recording in recordings:
        time = columns["time"][recording.lines]
        columns["time"][recording.lines] = time - time[:1]
    takes = takes_of(recordings)
    if len(np.unique(takes)) < len(takes):
        columns["take"] = takes[columns["recording"]]
    if recordings[0].has_split:
        columns["split"] = _splits(columns, recordings, frames)
    else:
        columns.pop("split", None)
    return columns


def _add_from_files(
    columns: dict[str, np.ndarray], recordings: Sequence[Named], frames: int
) -> None:
    """Copy the columns of the files into the columns of all frames, and add new ones."""
    for recording in recordings:
        found = recording.found
        rows = slice(found.first, found.first + found.frames)
        for name, values in found.recording.values.items():
            if name not in columns:
                columns[name] = np.zeros(frames)
            columns[name][rows] = values


def _splits(
    columns: Mapping[str, np.ndarray], recordings: Sequence[Named], frames: int
) -> np.ndarray:
    """Return the code of each frame's published set."""
    codes = columns.get("split", np.zeros(frames)).copy()
    for recording in recordings:
        if not recording.is_split_by_frame:
            codes[recording.lines] = SIDES.index(recording.names["split"])
    return codes


def first_fault(
    columns: Mapping[str, np.ndarray], ids: Mapping[str, Sequence[str]], fault: Fault | None
) -> Fault | None:
    """Return the first fault among the columns and `fault`; None if there is none.

    Args:
        columns: the columns of all frames.
        ids: the names by the column that holds their numbers.
        fault: the first fault among the readings, if there is one.
    """
    for name, values in columns.items():
        dtype = np.dtype(COLUMNS[name])
        low, high = limits(name, dtype)
        if name in ids:
            low = 0
            high = min(high, len(ids[name]) - 1)
        is_whole = dtype.kind != "f"
        row = first_unfit(values, low, high, is_whole=is_whole, may_be_nan=name == "time")
        if row is not None and (fault is None or row < fault.row):
            fault = Fault(name, row, float(values[row]), low, high, is_whole)
    return fault


def fault_text(
    path: Path, fault: Fault, columns: Mapping[str, np.ndarray], recordings: Sequence[str]
) -> str:
    """Return a text that names a value out of range, its place, and the remedy.

    Args:
        path: the path of the source.
        fault: the value.
        columns: the columns of all frames.
        recordings: the names of the recordings.
    """
    name = recordings[int(columns["recording"][fault.row])]
    frame = int(columns["frame"][fault.row])
    kind = "whole" if fault.is_whole else "real"
    text = f"{path}: {fault.column} of frame {frame} of recording {name} is {fault.value:.10g}; "
    text += f"expected {kind} numbers from {fault.low:.10g} to {fault.high:.10g}"
    if np.isnan(fault.value):
        text += UNREAD
    return text
