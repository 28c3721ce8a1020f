"""Files of recordings in every form, and what becomes of them when they are read."""

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
    """A recording in HDF5, of a mug in session s1 unless the attributes say otherwise; None leaves
    a thing out.
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
    """An array as .npy, a mapping of arrays as .npz, or the text or the bytes of a file."""
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


def read_here(path: Path, out: Path, form: Form = AUTO) -> Recordings:
    """The table of the recordings at a path, written to `out` in this process."""
    write_recordings(out, discover(path, form), form)
    return Recordings.read(out)


def ingested(path: Path, **options) -> tuple[np.ndarray, Recordings]:
    """All frames of the recordings at a path, and their table, read in this process."""
    table = read_here(path, path.parent / f"{path.name}.table", **options)
    return table.counts[np.arange(len(table))], table


def refusal(path: Path, place: Path, **options) -> str:
    """The line that ends the reading of a path, "" if it is read; in time, and with nothing left in
    `place`/out.
    """
    (out := place / "out").mkdir(exist_ok=True)
    begin, line = sum(os.times()[:4]), ""
    try:
        read_source(path, out / "table", **options)
        rmtree(out / "table")
    except UserError as error:
        line = str(error)
    assert list(out.iterdir()) == []
    # seconds of this process and of those that ended
    assert sum(os.times()[:4]) - begin < 20 and "\n" not in line
    return line
