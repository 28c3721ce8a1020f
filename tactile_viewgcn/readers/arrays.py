"""Reading folders of arrays, one file a recording: OBJECT/FILE, or with folders of sessions or sides.

An array is (frames, rows, columns), or (frames, cells) with the cells row after row. With a shape (rows and
columns of a frame) it may also be one frame; without one, (frames, cells) are frames of one row.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.files import TEXTS, arrays_below
from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.columns import Columns, columns_of, named, sensors_and_time, starts
from tactile_viewgcn.readers.folder import UNNAMED, Names, joined
from tactile_viewgcn.readers.places import Layout, layout_of
from tactile_viewgcn.readers.source import (
    AUTO,
    FRAMES_LAST,
    Form,
    Source,
    Values,
    check_shape,
    framed,
    listed,
    numbered,
    pressure_name,
    side_of,
    sliced,
    storage_type,
)
from tactile_viewgcn.readers.stag import matlab_fields, matlab_names
from tactile_viewgcn.readers.text import Table, read_table

SOME = 5  # tables whose names are compared


def read_arrays(path: Path, form: Form = AUTO) -> Source:
    """All files of arrays below a folder, see `layout_of`, or one file; without sessions there is one.

    Raises:
        UserError: lists the mistakes of all files, and where they differ in shape or depth, or share a name.
    """
    files = arrays_below(path)
    some = [columns_of(table, form) for table in islice(_tables(files, path), SOME)]
    columns = max(some, key=lambda columns: [each.names for each in some].count(columns.names), default=None)
    if columns and (missing := [name for name in form.columns.values() if name not in columns.names]):
        texts = listed(columns.names) if columns.is_shown else "others"
        raise UserError(f"{path}: no column {missing[0]!r}; found {texts}")
    is_alone = len(files) == 1 and files[0].parent == (path if path.is_dir() else path.parent)
    names, notes = named(columns.names, form) if columns else {}, list[Note]()
    has_parts = columns and ("recording" in names or columns.restarts)
    if columns and is_alone and ("object" in names or (has_parts and not form.labelled)):
        source = _labelled(files[0], columns, form)
    else:
        layout = layout_of(path, files, form)
        source = joined(path, files, partial(_opened, path=path, layout=layout, form=form, columns=columns))
        with suppress(UserError):  # the file that is shown may be a stray one
            notes = layout.note(files[0])
    if columns and len(columns.sensors) == math.prod(source.shape):
        source.notes.extend(columns.notes)
        source.channel_names.extend(columns.channel_names)
    source.notes.extend(notes)
    return source


def _is_table(file: Path) -> bool:
    return file.name.lower().endswith(TEXTS)


def _tables(files: Sequence[Path], path: Path) -> Iterator[Table]:
    """The tables in files, but for those that cannot be read, whose mistakes `joined` lists."""
    for file in filter(_is_table, files):
        with suppress(UserError), reading(file):
            yield read_table(file, path)


def _labelled(file: Path, columns: Columns, form: Form) -> Source:
    """The recordings in a table whose columns name them: the lines of one object, session and recording.

    Where no column names recordings, one begins where the object or the session changes, and where the time falls.

    Raises:
        UserError: a cell holds no number or no name.
    """
    with reading(file):
        table = read_table(file, file)
        values, texts = sensors_and_time(table, columns, form), dict[str, list[Any]]()
        for kind, at in named(table.names, form).items():
            for row in np.flatnonzero(table.cells[at].isna())[:1]:
                where = f"line {table.line(row)}, column {at + 1}"
                raise UserError(f"{file}: {where} is empty; expected the name of the {kind} in each line")
            texts[kind] = [str(cell).strip() for cell in table.cells[at]]
    if "recording" not in texts:
        begins = starts(table, form)
        begins[1:] |= np.diff(values.get("time", np.zeros(len(begins)))) < 0
        texts["recording"] = [str(number) for number in np.cumsum(begins)]
    keys = list(zip(*(texts[kind] for kind in ("session", "object", "recording") if kind in texts), strict=True))
    texts = {kind: [name] * len(keys) for kind, name in UNNAMED.items()} | texts | {"recording": keys}
    names: dict[str, list[Any]] = {kind: numbered(texts[kind]) for kind in UNNAMED}
    names["recording"] = list(dict.fromkeys(keys))
    for kind, distinct in names.items():
        number = {name: at for at, name in enumerate(distinct)}
        values[kind] = np.array([number[text] for text in texts[kind]])
    order = np.argsort(values["recording"], kind="stable")
    values = {name: column[order] for name, column in values.items()}
    first = np.searchsorted(values["recording"], values["recording"])  # of each line the first one of its recording
    values["frame"] = np.arange(len(order)) - first
    if "time" in values:
        values["time"] = values["time"] - values["time"][first]
    pressure = values["pressure"] = framed(values["pressure"], form, str(file))
    if form.shape == FRAMES_LAST or len(pressure) != len(order):
        raise UserError(f"{file}: one table of all recordings has a frame in each line; expected data.shape of a frame")
    shape, dtype = check_shape(pressure.shape, str(file)), storage_type(pressure.dtype, str(file))
    names["recording"] = list(map("/".join, names["recording"]))
    return Source(file, names, shape, dtype, len(order), sliced(values, len(order)))


@contextmanager
def _opened(
    file: Path, path: Path, layout: Layout, form: Form, columns: Columns | None
) -> Iterator[tuple[Names, Values]]:
    names = layout.names(file, labelled=form.labelled)
    values = sensors_and_time(read_table(file, path), columns, form) if _is_table(file) else _read(file, form)
    values["pressure"] = framed(values["pressure"], form, str(file))
    if side := names.pop("split", ""):
        values["split"] = np.full(len(values["pressure"]), side_of(side, str(file)))
    yield names, values


def _read(file: Path, form: Form) -> dict[str, np.ndarray]:
    """`pressure`, and `time` where the form names it; .npy is memory-mapped. Nothing is unpickled."""
    if other := form.columns.keys() - {"pressure", "time"}:
        raise UserError(f"{file}: data.columns names {listed(sorted(other))}; an array has `pressure` and `time` alone")
    if file.suffix.lower() == ".npy":
        array = np.load(file, mmap_mode="r", allow_pickle=False)
        if array.offset + array.nbytes != file.stat().st_size:
            raise ValueError("there are more bytes after the array")
        return {"pressure": array}
    if file.suffix.lower() == ".mat":
        in_file = dict(form.columns) | {"pressure": pressure_name(matlab_names(file), form, str(file))}
        arrays = {name: field[:] for name, field in matlab_fields(file, tuple(in_file.values())).items()}
    else:
        with np.load(file, allow_pickle=False) as stored:
            in_file = dict(form.columns) | {"pressure": pressure_name(list(stored), form, str(file))}
            arrays = {name: stored[name] for name in in_file.values() if name in stored}
    if missing := [name for name in in_file.values() if name not in arrays]:
        raise UserError(f"{file}: no array {missing[0]}")
    values = {kind: np.asarray(arrays[name]) for kind, name in in_file.items()}
    return {kind: array.ravel() if kind == "time" else array for kind, array in values.items()}
