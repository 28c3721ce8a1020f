"""Reading folders of STAG's raw recordings, `[batch]/[recording]/pressuredata.mat`."""

import math
import re
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.source import (
    BLOCK_FRAMES,
    EMPTY_HAND,
    Block,
    Source,
    check_shape,
    raise_mistakes,
    storage_type,
)
from tactile_viewgcn.readers.stag_metadata import frame_column, readable_mat

RAW_FIELDS = ("pressure", "tStamp", "frame")
NOT_NUMBERS = ("char", "cell", "struct", "object", "function", "opaque")  # MATLAB's other classes
MISSING_PRESSURE = "no field pressure; expected STAG's pressuredata.mat"


def read_folder(path: Path) -> Source:
    """A STAG folder `[batch]/[recording]/pressuredata.mat`, one recording in memory at a time.

    A recording's object is its name without the number ("003-tea_box" holds tea_box). Raw recordings have no flags
    and no split. Objects are numbered in the order of their names, the empty hand first.

    Raises:
        UserError: no recordings, or fields of the wrong kind or shape; the message lists the mistakes of all files,
            from their headers. Other damage is reported when its file is read.
    """
    files = sorted(path.glob("*/*/pressuredata.mat"))
    if not files:
        raise UserError(f"{path}: no [batch]/[recording]/pressuredata.mat in it")
    sessions = sorted({file.parent.parent.name for file in files})
    held = [re.sub(r"^\d+-", "", file.parent.name) for file in files]
    objects = sorted(set(held), key=lambda name: (name != EMPTY_HAND, name))
    shape = _common_shape(files)
    dtype = storage_type(_read_recording(files[0])[0].dtype, str(files[0]))

    def blocks() -> Iterator[Block]:
        for number, (file, name) in enumerate(zip(files, held, strict=True)):
            pressure, time, frame = _read_recording(file)
            if storage_type(pressure.dtype, str(file)) != dtype:
                raise UserError(f"{file}: pressure is of type {pressure.dtype}; expected {dtype} as in {files[0]}")
            for start in range(0, len(pressure), BLOCK_FRAMES):
                at = slice(start, start + BLOCK_FRAMES)
                count = len(pressure[at])
                yield {
                    "pressure": np.ascontiguousarray(pressure[at]),
                    "time": time[at],
                    "frame": frame[at],
                    "object": np.full(count, objects.index(name)),
                    "recording": np.full(count, number),
                    "session": np.full(count, sessions.index(file.parent.parent.name)),
                }

    names = [f"{file.parent.parent.name}/{file.parent.name}" for file in files]
    return Source(path, objects, names, sessions, shape, dtype, blocks())


def _common_shape(files: list[Path]) -> tuple[int, int]:
    """(H, W) of the frames of all raw recordings.

    Raises:
        UserError: lists the files that cannot be read or differ from the first.
    """
    shapes: dict[Path, tuple[int, int]] = {}
    mistakes = []
    for file in files:
        try:
            shapes[file] = _frame_shape(file)
        except UserError as error:
            mistakes.append(str(error))
    first, expected = next(iter(shapes.items()), (files[0], (0, 0)))
    mistakes += [
        f"{file}: frames of {shape}; expected {expected} as in {first}"
        for file, shape in shapes.items()
        if shape != expected
    ]
    raise_mistakes(mistakes)
    return expected


def _frame_shape(path: Path) -> tuple[int, int]:
    """(H, W) of a raw recording, after checks of its fields' kinds and lengths by the file's header alone.

    A header does not tell in which type MATLAB stored whole numbers of class double, so types are compared when
    the frames are read.
    """
    from scipy import io

    with readable_mat(path):
        if h5py.is_hdf5(path):
            with h5py.File(path, "r") as file:
                header = {name: (file[name].shape[::-1], str(file[name].dtype)) for name in RAW_FIELDS if name in file}
        else:
            header = {name: (shape, kind) for name, shape, kind in io.whosmat(str(path))}
    if "pressure" not in header:
        raise UserError(f"{path}: {MISSING_PRESSURE}")
    shape, kind = header["pressure"]
    frame_shape = check_shape(shape, str(path))
    if kind in NOT_NUMBERS:
        raise UserError(f"{path}: pressure is of type {kind}; expected integer counts or real numbers")
    for name in ("tStamp", "frame"):
        if name in header and (size := math.prod(header[name][0])) != shape[0]:
            raise UserError(f"{path}: {name} has {size} values for {shape[0]} frames; expected one for each frame")
    return frame_shape


def _read_recording(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """pressure (T, H, W), seconds since the first frame (T,) and frame number (T,) of one raw recording."""
    from scipy import io

    with readable_mat(path):
        if h5py.is_hdf5(path):
            with h5py.File(path, "r") as file:
                fields = {name: file[name][()].T for name in RAW_FIELDS if name in file}
        else:
            fields = io.loadmat(str(path), variable_names=RAW_FIELDS)
    if "pressure" not in fields:
        raise UserError(f"{path}: {MISSING_PRESSURE}")
    pressure = fields["pressure"]
    frames = len(pressure)
    time = frame_column(fields["tStamp"], "tStamp", frames, path) if "tStamp" in fields else np.full(frames, np.nan)
    frame = frame_column(fields["frame"], "frame", frames, path) if "frame" in fields else np.arange(frames)
    return pressure, time - (time[0] if frames else 0), frame
