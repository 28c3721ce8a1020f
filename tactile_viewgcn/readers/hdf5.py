"""Reading recordings in HDF5, the project's own form for gloves other than STAG: one file a recording.

/pressure     (T, H, W)  integer counts or real numbers, up to 256 x 256
/time         (T,)       seconds, optional
/valid        (T,)       whether the object is held, optional
/grasp        (T,)       number of the grasp, optional
/grasp_valid  (T,)       whether the frame is in the steady part of its grasp, optional
attributes    object, session; optional: recording (else the file's path in the folder), split ("train" or "test")

A file may come from anybody: nothing in it leads to a different file.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.files import HDF5, files_below
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.folder import Names, joined
from tactile_viewgcn.readers.places import Layout, layout_of
from tactile_viewgcn.readers.source import (
    AUTO,
    FRAMES_LAST,
    NUMBERS,
    SOURCE_MD5,
    Form,
    Source,
    Values,
    framed,
    listed,
    no_array,
    side_of,
)

DATASETS = ("pressure", "time", "valid", "grasp", "grasp_valid")
ATTRIBUTES = ("object", "session", "recording", "split")
CACHE = 64 * 2**20  # bytes of a chunk that is kept for the next block


def read_hdf5(path: Path, form: Form = AUTO) -> Source:
    """One recording, or all .h5 and .hdf5 files below a folder in the order of their paths.

    The folders of a file without an attribute `object` name object and session, see `layout_of`.

    Raises:
        UserError: lists the mistakes of all files, and where they differ in shape or columns, or share a name.
    """
    files, root = ([path], path.parent) if path.is_file() else (files_below(path, HDF5), path)
    layout = cache(partial(layout_of, path, files, form))
    source = joined(path, files, partial(_opened, root=root, layout=layout, form=form))
    source.notes.extend(layout().note(files[0]) if layout.cache_info().currsize else [])
    return source


@contextmanager
def _opened(path: Path, root: Path, layout: Callable[[], Layout], form: Form) -> Iterator[tuple[Names, Values]]:
    with open_hdf5(path) as file:
        if SOURCE_MD5 in file.attrs:
            raise UserError(f"{path}: the table that ingest writes, not a recording; keep it out of the source")
        in_file = {name: form.columns.get(name, name) for name in (*DATASETS, *ATTRIBUTES)}
        values: dict[str, Any] = {}
        for name in DATASETS:
            with suppress(KeyError):
                values[name] = dataset(file, in_file[name], "numbers")
        if "pressure" not in values:
            raise no_array(in_file["pressure"], list(file), str(path))
        if values["pressure"].ndim != 3 or form.shape == FRAMES_LAST:
            values["pressure"] = framed(values["pressure"][()], form, str(path))
        texts = {name: _attribute(file, in_file[name]) for name in ATTRIBUTES if in_file[name] in file.attrs}
        if missing := form.columns.keys() - values.keys() - texts.keys():
            raise UserError(f"{path}: no {form.columns[missing.pop()]}; found {listed([*file, *file.attrs])}")
        if form.labelled and not texts.get("object"):
            try:
                texts = layout().names(path, labelled=True) | texts
            except UserError as error:
                raise UserError(f"{error}; or an attribute `object` in the file") from None
        if "split" in texts:
            values["split"] = np.full(len(values["pressure"]), side_of(texts["split"], str(path)))
        place = path.relative_to(root).with_suffix("").as_posix()
        yield {"recording": place} | texts, values


def open_hdf5(path: Path) -> h5py.File:
    """An HDF5 file, open for reading."""
    return h5py.File(path, "r", rdcc_nbytes=CACHE)


def _attribute(file: h5py.File, name: str) -> str:
    """An attribute of the root as text; a UserError where it is not one text or number."""
    value = file.attrs[name]
    value = value.ravel()[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    if not isinstance(value, str | bytes | np.number | np.bool_):
        raise UserError(f"{file.filename}: attribute {name} is not a single text; expected one")
    return value.decode() if isinstance(value, bytes) else str(value)


def dataset(file: h5py.File, name: str, *kinds: str) -> h5py.Dataset:
    """A dataset in the root, or at the end of a soft link within the file, checked by `check_dataset`.

    Raises:
        KeyError: there is none.
        UserError: the link leads out of the file or nowhere, or as `check_dataset`.
    """
    parts, place = list(filter(None, name.split("/"))), file
    if parts and file.get(parts[0], getlink=True) is None:
        raise KeyError(f"no /{name}")
    if len(parts) == 1 and isinstance(link := file.get(name, getlink=True), h5py.SoftLink):
        parts = list(filter(None, link.path.split("/")))
    for part in parts:
        if not isinstance(place, h5py.Group) or not isinstance(place.get(part, getlink=True), h5py.HardLink):
            raise UserError(f"{file.filename}: /{name} leads out of the file or nowhere; expected it in the file")
        place = place[part]
    check_dataset(place, f"{file.filename}: /{name}", *kinds)
    return place


def check_dataset(values: h5py.Dataset | h5py.Group, where: str, *kinds: str) -> None:
    """Raise a UserError for a group, for values outside the file, and for values of none of the `kinds` of `kind_of`.

    Args:
        where: the message begins with it.
    """
    if not isinstance(values, h5py.Dataset):
        raise UserError(f"{where} is a group; expected a dataset")
    if values.is_virtual or values.external:
        raise UserError(f"{where} has its values outside the file; expected them in it")
    if values.shape is None or kind_of(values.dtype) not in kinds:
        raise UserError(f"{where} is of type {values.dtype if values.shape else None}; expected {' or '.join(kinds)}")


def kind_of(dtype: np.dtype) -> str:
    """`numbers`, `references`, or the name of any other type."""
    is_reference = h5py.check_ref_dtype(dtype) is h5py.Reference
    return "references" if is_reference else "numbers" if dtype.kind in NUMBERS else str(dtype)
