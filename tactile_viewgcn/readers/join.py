"""How the recordings of several files become one source."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, listed, once_each, several
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.source import (
    AUTO,
    UNLABELLED,
    Block,
    Form,
    Recording,
    Source,
    Values,
    check_shape,
    framed,
    sliced,
    storage_type,
    tidy,
)

#: Words of a file's name by which files of one recording differ: a hand, an axis, a part of its time, a device.
PART = re.compile(
    r"(?<![a-z])(left|right|lh|rh|[lrxyz]|(part|window|win|segment|seg|chunk)[ _-]?\d+|"
    r"(device|dev|sensor|glove|imu|emg|accel|acc|gyro|mag|board)\d*)(?![a-z])"
)


def joined(path: Path, files: list[Path], opened: Callable[[Path], list[Recording]], form: Form = AUTO) -> Source:
    """The source of the recordings in files, of which one file is in memory at a time.

    Args:
        path: the source's path, for its errors.
        opened: opens a file: first for its names and shapes, and again for its frames.

    Raises:
        UserError: lists the files that cannot be read, or are unlike the first one, or have the name of an earlier one.
    """

    def read(file: Path) -> Iterator[Recording]:
        for recording in opened(file):
            pressure = framed(recording.values["pressure"], form, str(file))
            names = {"object": UNLABELLED, "session": "session"} | recording.names
            names |= {kind: tidy(names[kind]) for kind in ("object", "session")}
            yield replace(recording, names=names, values=recording.values | {"pressure": pressure})

    known, headers, mistakes = dict[str, tuple[Any, Path]](), list[Recording](), list[tuple[Path, str]]()
    dtypes, frames = set[np.dtype](), 0
    for file in files:
        try:
            with reading(file):
                for recording in read(file):
                    dtypes.add(_check(recording, file, known))
                    frames += len(recording.values["pressure"])
                    headers.append(replace(recording, values={}))
        except UserError as error:
            mistakes.append((file, str(error)))
    if mistakes:
        raise UserError(listed(once_each(mistakes), "; "))
    ids = {
        "object": sorted({header.names["object"] for header in headers}, key=lambda name: (name != EMPTY_HAND, name)),
        "recording": [header.names["recording"] for header in headers],
        "session": sorted({header.names["session"] for header in headers}),
    }
    notes = list(headers[0].notes)
    if dropped := sum(header.dropped for header in headers):
        text = f"{several(dropped, 'frame')} without readings, in which nothing is held, are left out"
        notes.append(Note(text, topic="frames"))

    takes = [take_of(header) for header in headers]
    first = {take: number for number, take in reversed([*enumerate(takes)])}
    if len(first) < len(takes) and "take" not in headers[0].names:
        again = next(take for number, take in enumerate(takes) if first[take] < number)
        pair = [name for name, take in zip(ids["recording"], takes, strict=True) if take == again][:2]
        text = (
            f"{several(len(takes), 'recording')} have {len(first):,} names without hand, axis, device or part, such as "
            f"{' and '.join(pair)}: these are held out together. To join them, save one file with the columns of both."
        )
        notes.append(Note(text, "warning", "parts"))

    def blocks() -> Iterator[Block]:
        for file in files:
            with reading(file):
                for recording in read(file):
                    values = recording.values
                    count = len(values["pressure"])
                    values |= {kind: np.full(count, names.index(recording.names[kind])) for kind, names in ids.items()}
                    if len(first) < len(takes):
                        values["take"] = np.full(count, first[take_of(recording)])
                    if "time" in values:
                        time = values["time"][:].astype(np.float64)
                        values["time"] = time - time[:1]
                    yield from sliced(values, count)

    shape, channels = known["shape"][0], known["channels"][0]
    channels = channels if len(channels) == shape[0] * shape[1] else []
    return Source(path, ids, shape, np.result_type(*dtypes), frames, blocks(), notes, channels)


def take_of(recording: Recording) -> tuple[str, str]:
    """The object, and what recordings that belong together have in common: their name without the word of `PART`.

    A name that would have no number left keeps that of its device or part: glove1 and glove2 may be two grasps.
    """
    names = recording.names
    folder, mark, name = names["recording"].rpartition("/")
    plain = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()
    stem = PART.sub("", plain)
    is_number = re.search(r"\d", plain) and not re.search(r"\d", stem)
    return names["object"], names.get("take", folder + mark + (name if is_number else stem))


def _check(recording: Recording, file: Path, known: dict[str, tuple[Any, Path]]) -> np.dtype:
    """Check a recording, see `joined`.

    Args:
        known: what the first file has, with that file, and the names of all recordings; it is added to.

    Returns:
        The type in which the table stores its pressure.
    """
    shape, dtype = check_values(recording.values, str(file))
    columns = [name for name in recording.values if name not in ("pressure", "frame")]
    for what, found in {"shape": shape, "columns": columns, "channels": recording.channel_names}.items():
        expected, other = known.setdefault(what, (found, file))
        if found != expected:
            raise UserError(f"{file}: {what} {found}; expected {expected} as in {other}")
    name = f"recording {recording.names['recording']!r}"
    if name in known:
        remedy = "expected a name for each: of its file without the ending, or in HDF5 the attribute `recording`"
        raise UserError(f"{file}: {name}, as in {known[name][1]}; {remedy}")
    known[name] = name, file
    return dtype


def check_values(values: Values, where: str) -> tuple[tuple[int, int], np.dtype]:
    """Shape (H, W) of pressure (T, H, W), and the type in which the table stores it.

    Raises:
        UserError: begins with `where`; pressure is of no such shape or type, or a column is not (T,).
    """
    shape, frames = check_shape(values["pressure"].shape, where), values["pressure"].shape[:1]
    for name, column in values.items():
        if name != "pressure" and column.shape != frames:
            raise UserError(f"{where}: {name} has shape {column.shape}; expected {frames}, one for each frame")
    return shape, storage_type(values["pressure"].dtype, where)
