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

import numpy as np

from tactile_viewgcn.files import TEXTS, arrays_below
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.columns import Columns, columns_of, named, sensors_and_time
from tactile_viewgcn.readers.folder import Names, joined
from tactile_viewgcn.readers.labelled_table import read_labelled
from tactile_viewgcn.readers.places import Layout, layout_of
from tactile_viewgcn.readers.source import (
    AUTO,
    UNLABELLED,
    Form,
    Source,
    Values,
    framed,
    listed,
    pressure_name,
    side_of,
)
from tactile_viewgcn.readers.stag import matlab_fields, matlab_names
from tactile_viewgcn.readers.text import Table, read_table

SOME = 5  # tables whose names are compared


def read_arrays(path: Path, form: Form = AUTO, *, labelled: bool = True) -> Source:
    """All files of arrays below a folder, see `layout_of`; without sessions there is one.

    Args:
        labelled: False: files may lie in no object's folder, or be one file; their object is `UNLABELLED`.

    Raises:
        UserError: lists the mistakes of all files, and where they differ in shape or depth, or share a name.
    """
    files = arrays_below(path)
    some = [columns_of(table, form) for table in islice(_tables(files, path), SOME)]
    columns = max(some, key=lambda columns: [each.names for each in some].count(columns.names), default=None)
    if columns and (missing := [name for name in form.columns.values() if name not in columns.names]):
        texts = listed(columns.names) if columns.is_shown else "others"
        raise UserError(f"{path}: no column {missing[0]!r}; found {texts}")
    is_alone = columns and files[0].parent == (path if path.is_dir() else path.parent) and len(files) == 1
    names = named(columns.names, form).keys() if columns else set()
    if columns and is_alone and ("object" in names or (not labelled and ("recording" in names or columns.restarts))):
        return read_labelled(files[0], columns, form)
    layout = layout_of(path, files, form.layout, labelled=labelled)
    source = joined(
        path, files, partial(_opened, path=path, layout=layout, form=form, labelled=labelled, columns=columns)
    )
    if columns and len(columns.sensors) == math.prod(source.shape):
        source.notes.extend(columns.notes)
        source.channel_names.extend(columns.channel_names)
    with suppress(UserError):  # the file that is shown may be a stray one
        source.notes.extend(layout.note(files[0]))
    return source


def _is_table(file: Path) -> bool:
    return file.name.lower().endswith(TEXTS)


def _tables(files: Sequence[Path], path: Path) -> Iterator[Table]:
    """The tables in files, but for those that cannot be read, whose mistakes `joined` lists."""
    for file in filter(_is_table, files):
        with suppress(UserError), reading(file):
            yield read_table(file, path)


@contextmanager
def _opened(
    file: Path, path: Path, layout: Layout, form: Form, labelled: bool, columns: Columns | None
) -> Iterator[tuple[Names, Values]]:
    names = layout.names(file, labelled=labelled)
    values = sensors_and_time(read_table(file, path), columns, form) if _is_table(file) else _read(file, form)
    values["pressure"] = framed(values["pressure"], form, str(file))
    if side := names.pop("split", ""):
        values["split"] = np.full(len(values["pressure"]), side_of(side, str(file)))
    yield {"object": UNLABELLED, "session": "session"} | names, values


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
        names, times = matlab_names(file), form.columns.get("time", "")
        in_file = {"pressure": pressure_name(names, form, str(file))} | ({"time": times} if times else {})
        fields = matlab_fields(file, tuple(in_file.values()))
        arrays = {name: np.asarray(fields[in_file[name]][:]) for name in in_file if in_file[name] in fields}
    else:
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            in_file = {"pressure": pressure_name(list(stored), form, str(file))}
            in_file |= {"time": form.columns["time"]} if "time" in form.columns else {}
            arrays = {name: stored[in_file[name]] for name in in_file if in_file[name] in stored}
    if missing := in_file.keys() - arrays.keys():
        raise UserError(f"{file}: no array {in_file[missing.pop()]}")
    return {name: array.ravel() if name == "time" else array for name, array in arrays.items()}
