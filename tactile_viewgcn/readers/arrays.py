"""Reading folders of arrays, one file a recording: OBJECT/FILE, or with folders of sessions or sides.

An array is (frames, rows, columns), or (frames, cells) with the cells row after row. With a shape (rows and
columns of a frame) it may also be one frame; without one, (frames, cells) are frames of one row.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import numpy as np

from tactile_viewgcn.files import TEXTS, arrays_below
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.columns import Columns, columns_of, named, sensors_and_time
from tactile_viewgcn.readers.folder import Names, joined
from tactile_viewgcn.readers.labelled_table import read_labelled
from tactile_viewgcn.readers.places import SIDES, Layout, layout_of
from tactile_viewgcn.readers.source import AUTO, UNLABELLED, Form, Source, Values, framed, pressure_name
from tactile_viewgcn.readers.stag import matlab_fields, matlab_names
from tactile_viewgcn.readers.text import Table, read_table


def read_arrays(path: Path, form: Form = AUTO, *, labelled: bool = True) -> Source:
    """All files of arrays below a folder, see `layout_of`; without sessions there is one.

    Args:
        labelled: False: files may lie in no object's folder, or be one file; their object is `UNLABELLED`.

    Raises:
        UserError: lists the mistakes of all files, and where they differ in shape or depth, or share a name.
    """
    files = arrays_below(path)
    columns = next((columns_of(table, form) for table in _tables(files)), None)
    if columns and path.is_file() and {"object", *["recording"] * (not labelled)} & named(columns.names, form).keys():
        return read_labelled(path, columns, form)
    layout = layout_of(path, files, form.layout, labelled=labelled)
    source = joined(path, files, partial(_opened, layout=layout, form=form, labelled=labelled, columns=columns))
    if columns:
        source.notes.extend(columns.notes)
        source.channel_names.extend(columns.channel_names)
    with suppress(UserError):  # the file that is shown may be a stray one
        source.notes.extend(layout.note(files[0]))
    return source


def _is_table(file: Path) -> bool:
    return file.name.lower().endswith(TEXTS)


def _tables(files: Sequence[Path]) -> Iterator[Table]:
    """The tables in files, but for those that cannot be read, whose mistakes `joined` lists."""
    for file in filter(_is_table, files):
        with suppress(UserError), reading(file):
            yield read_table(file)


@contextmanager
def _opened(
    file: Path, layout: Layout, form: Form, labelled: bool, columns: Columns | None
) -> Iterator[tuple[Names, Values]]:
    names = layout.names(file, labelled=labelled)
    values = sensors_and_time(read_table(file), columns, form) if _is_table(file) else {"pressure": _read(file, form)}
    values["pressure"] = framed(values["pressure"], form, str(file))
    if side := names.pop("split", ""):
        values["split"] = np.full(len(values["pressure"]), SIDES[side.lower()])
    yield {"object": UNLABELLED, "session": "session"} | names, values


def _read(file: Path, form: Form) -> np.ndarray:
    """The array in a file; .npy is memory-mapped. Nothing is unpickled."""
    if file.suffix.lower() == ".mat":
        name = pressure_name(matlab_names(file), form, str(file))
        return np.asarray(matlab_fields(file, (name,))[name][:])
    if file.suffix.lower() == ".npz":
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
            return arrays[pressure_name(list(arrays), form, str(file))]
    array = np.load(file, mmap_mode="r", allow_pickle=False)
    if array.offset + array.nbytes != file.stat().st_size:
        raise ValueError("there are more bytes after the array")
    return array
