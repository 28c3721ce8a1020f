"""Reading folders of STAG's raw recordings, `[batch]/[recording]/pressuredata.mat`."""

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.notes import several
from tactile_viewgcn.readers.matlab import NOT_NUMBERS, mat_fields, mat_shapes
from tactile_viewgcn.readers.source import (
    BLOCK_FRAMES,
    Block,
    Source,
    check_shape,
    numbered,
    raise_mistakes,
    storage_type,
)
from tactile_viewgcn.readers.stag_metadata import frame_column

RAW_FIELDS = ("pressure", "tStamp", "frame")


def stag_files(path: Path) -> list[Path]:
    """The raw recordings in a folder, in the order of their paths; hidden folders are left out."""
    return sorted(path.glob("[!.]*/[!.]*/pressuredata.mat"))


def read_folder(path: Path) -> Source:
    """A STAG folder `[batch]/[recording]/pressuredata.mat`, one recording in memory at a time.

    A recording's object is its name without the number ("003-tea_box" holds tea_box). There are no flags, no split.

    Raises:
        UserError: lists fields of the wrong kind or shape in all files, from their headers. Other damage is reported
            when its file is read.
    """
    files = stag_files(path)
    sessions = sorted({file.parent.parent.name for file in files})
    object_of = [re.sub(r"^\d+-", "", file.parent.name) for file in files]
    objects = numbered(object_of)
    shapes: dict[Path, tuple[int, int, int]] = {}
    mistakes = []
    for file in files:
        try:
            shapes[file] = _shape(file)
        except UserError as error:
            mistakes.append(str(error))
    first = next(iter(shapes), files[0])
    mistakes += [
        f"{file}: frames of {shape[1:]}; expected {shapes[first][1:]} as in {first}"
        for file, shape in shapes.items()
        if shape[1:] != shapes[first][1:]
    ]
    raise_mistakes(mistakes)
    dtype = storage_type(_read_recording(files[0])[0].dtype, str(files[0]))

    def blocks() -> Iterator[Block]:
        for number, (file, name) in enumerate(zip(files, object_of, strict=True)):
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
    frames = sum(shape[0] for shape in shapes.values())
    return Source(path, objects, names, sessions, shapes[first][1:], dtype, frames, blocks())


def _shape(path: Path) -> tuple[int, int, int]:
    """(T, H, W) of a raw recording, after checks of its fields' kinds and lengths by the file's header alone."""
    header = mat_shapes(path)
    if "pressure" not in header:
        raise UserError(f"{path}: no field pressure; expected STAG's pressuredata.mat")
    for name in RAW_FIELDS:
        if name in header and (kind := header[name][1]) in NOT_NUMBERS:
            raise UserError(f"{path}: {name} is of type {kind}; expected integer counts or real numbers")
    shape = header["pressure"][0]
    sides = check_shape(shape, str(path))
    for name in ("tStamp", "frame"):
        if name in header and (size := math.prod(header[name][0])) != shape[0]:
            raise UserError(
                f"{path}: {name} has {several(size, 'value')} for {several(shape[0], 'frame')}; expected one for each"
            )
    return shape[0], *sides


def _read_recording(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """pressure (T, H, W), seconds since the first frame (T,) and frame number (T,) of one raw recording."""
    fields = mat_fields(path, RAW_FIELDS)
    frames = len(fields["pressure"])
    time = frame_column(fields["tStamp"], "tStamp", frames, path) if "tStamp" in fields else np.full(frames, np.nan)
    frame = frame_column(fields["frame"], "frame", frames, path) if "frame" in fields else np.arange(frames)
    return fields["pressure"], time - (time[0] if frames else 0), frame
