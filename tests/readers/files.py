"""Write files of recordings in every form, and read them."""

import os
from pathlib import Path
from shutil import rmtree

import h5py
import numpy as np

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.discovery import discover
from tactile_viewgcn.readers.source import AUTO, Form
from tactile_viewgcn.tables.reading import write_recordings
from tactile_viewgcn.tables.recordings import Recordings, read_source

COUNTS = np.arange(500, 640, dtype=np.int16).reshape(4, 5, 7)


def record(path: Path, *, pressure=COUNTS, attributes=(), **datasets) -> Path:
    """Write a recording in HDF5, of a mug in session s1 unless the attributes say otherwise.

    A dataset or an attribute of None is left out.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        for name, values in {"pressure": pressure, **datasets}.items():
            if values is not None:
                file[name] = values
        for name, value in ({"object": "mug", "session": "s1"} | dict(attributes)).items():
            if value is not None:
                file.attrs[name] = value
    return path


def save(path: Path, content=COUNTS) -> Path:
    """Save an array as .npy, a mapping of arrays as .npz, or a text or bytes as they are."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif isinstance(content, str):
        path.write_text(content, encoding="utf-8")
    elif isinstance(content, dict):
        np.savez_compressed(path, **content)
    else:
        np.save(path, content)
    return path


def read_here(path: Path, table: Path, form: Form = AUTO) -> Recordings:
    """Write the table of the recordings at a path to `table` in this process, and return it."""
    write_recordings(table, discover(path, form), form)
    return Recordings.read(table)


def ingested(path: Path, **options) -> tuple[np.ndarray, Recordings]:
    """Read the recordings at a path in this process; return all their frames and their table."""
    table = read_here(path, path.parent / f"{path.name}.table", **options)
    return table.counts[np.arange(len(table))], table


def refusal(path: Path, folder: Path, **options) -> str:
    """Return the error that ends the reading of a path; "" if the path is read.

    The reading must end in time, and leave nothing in the subfolder `out`.
    """
    output = folder / "out"
    output.mkdir(exist_ok=True)
    begin = _cpu_seconds()
    line = ""
    try:
        read_source(path, output / "table", **options)
        rmtree(output / "table")
    except UserError as error:
        line = str(error)
    assert list(output.iterdir()) == []
    assert _cpu_seconds() - begin < 20
    assert "\n" not in line
    return line


def _cpu_seconds() -> float:
    """Return the CPU time of this process and of its children that ended."""
    return sum(os.times()[:4])


def comma_separated(rows) -> str:
    """Return rows of cells as lines, with commas between the cells and no line end after them."""
    lines = [",".join(map(str, row)) for row in rows]
    return "\n".join(lines)
