"""Finding out in which form a path holds recordings, and opening them: STAG's, one table of all, or one file each.

An array is (frames, rows, columns), or (frames, cells) with the cells row after row. With a shape (rows and
columns of a frame) it may also be one frame; without one, (frames, cells) are frames of one row.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.files import ARRAYS, HDF5, TEXTS, all_below, arrays_below, files_below, stag_files
from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.columns import Columns, columns_of, named, recordings_in, sensors_and_time
from tactile_viewgcn.readers.folder import MANY, Names, joined
from tactile_viewgcn.readers.hdf5 import open_hdf5, read_recording
from tactile_viewgcn.readers.places import PLACES, Layout, layout_of, place_of
from tactile_viewgcn.readers.source import AUTO, Form, Source, Values, framed, listed, pressure_name, side_of
from tactile_viewgcn.readers.stag import matlab_fields, matlab_names, read_folder, read_metadata
from tactile_viewgcn.readers.text import Table, read_table

EXPECTED = (
    f"expected a STAG metadata.mat, a STAG folder, a folder of {PLACES}.npy, .npz, .mat, .csv, .txt or .h5, or a .csv "
    "with a column `object` (see the manual's page on data)"
)
SOME = 5  # tables whose names are compared


def open_source(path: str | Path, form: Form = AUTO) -> Source:
    """The source at a path: STAG's metadata.mat or folder, or recordings in HDF5, arrays and tables.

    A damaged file may crash this process; `read_source` uses a separate one.

    Args:
        form: of recordings that are not STAG's.

    Raises:
        FileNotFoundError: nothing is at that path.
        UserError: a file is of none of these forms, or damaged.
    """
    path, is_hdf5 = Path(path), False
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder; {EXPECTED}")
    if stag_files(path):
        return read_folder(path)
    if not path.is_dir():
        with reading(path):
            is_hdf5, is_stag = h5py.is_hdf5(path), path.name == "metadata.mat"
            if is_stag or ((is_hdf5 or path.suffix.lower() == ".mat") and matlab_fields(path, ("objectId",))):
                return read_metadata(path)
    arrays, hdf5 = ([], [path]) if is_hdf5 else (arrays_below(path), files_below(path, HDF5))
    few, many = sorted((arrays, hdf5), key=len)
    if few and len(few) * MANY > len(many):
        raise UserError(f"{path}: HDF5 recordings and arrays, {few[0]} and {many[0]}; keep one form elsewhere")
    if many:
        source = read_files(path, many, form)
        if few:
            text = f"{several(len(few), 'file')} of a different form left out beside {len(many):,}: "
            source.notes.append(Note(text + listed(list(map(str, few))), "warning", "files"))
        return source
    endings = sorted({file.suffix for file in (all_below(path) if path.is_dir() else [path])})
    raise UserError(f"{path}: no recordings in it, only files of {listed(endings)}; {EXPECTED}")


def read_files(path: Path, files: list[Path], form: Form) -> Source:
    """Files below a folder, or a single one: a recording each, or one table whose columns name recordings.

    Folders name objects and sessions, see `layout_of`, but for those of HDF5 files with an attribute `object`.

    Raises:
        UserError: as `joined`; or there is no column of a name that the form gives.
    """
    some = [columns_of(table, form) for table in islice(_tables(files, path), SOME)]
    columns = max(some, key=lambda columns: [each.names for each in some].count(columns.names), default=None)
    if columns and (missing := [name for name in form.columns.values() if name not in columns.names]):
        texts = listed(columns.names) if columns.is_shown else "others"
        raise UserError(f"{path}: no column {missing[0]!r}; found {texts}")
    is_alone = len(files) == 1 and files[0].parent == (path if path.is_dir() else path.parent)
    names = named(columns.names, form) if columns else {}
    has_parts = columns and ("recording" in names or columns.restarts)
    layout = cache(partial(layout_of, path, files, form))
    if columns and is_alone and ("object" in names or (has_parts and not form.labelled)):
        with reading(files[0]):
            parts = {
                Path(f"{files[0]}, recording {number}"): part
                for number, part in enumerate(recordings_in(read_table(files[0], path), columns, form), 1)
            }
        source = joined(path, list(parts), lambda part: nullcontext(parts[part]))
    else:
        if not any(file.suffix.lower() in HDF5 for file in files):  # which may name objects themselves
            layout()
        source = joined(path, files, partial(_opened, path=path, layout=layout, form=form, columns=columns))
    if columns and len(columns.sensors) == math.prod(source.shape):
        source.notes.extend(columns.notes)
        source.channel_names.extend(columns.channel_names)
    if layout.cache_info().currsize:
        with suppress(UserError):  # the file that is shown may be a stray one
            source.notes.extend(layout().note(files[0]))
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
    file: Path, path: Path, layout: Callable[[], Layout], form: Form, columns: Columns | None
) -> Iterator[tuple[Names, Values]]:
    is_array = file.name.lower().endswith((*ARRAYS, *TEXTS))
    with nullcontext() if is_array else open_hdf5(file) as hdf5:
        names, values = {"recording": place_of(file, path)}, dict[str, Any]()
        if hdf5:
            texts, values = read_recording(hdf5, form)
            names |= texts
        else:
            values = sensors_and_time(read_table(file, path), columns, form) if _is_table(file) else _read(file, form)
        values["pressure"] = framed(values["pressure"], form, str(file))
        if is_array or (form.labelled and not names.get("object")):
            names = layout().names(file, labelled=form.labelled) | names
        if side := names.pop("split", ""):
            values["split"] = np.full(len(values["pressure"]), side_of(side, str(file)))
        yield names, values


def _read(file: Path, form: Form) -> dict[str, Any]:
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
