"""Inspecting a source that has not been read yet."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from tactile_viewgcn.frames.baseline_leaks import with_every_leak
from tactile_viewgcn.frames.inspection import Inspection, inspect_recordings
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables.recordings import Recordings, is_table, write_recordings


def inspect_source(path: str | Path) -> Inspection:
    """Inspect a source in any form that `ingest` reads, or the table that it writes, leaks too.

    Raises:
        UserError: lists the mistakes of the source.
        FileNotFoundError: nothing at that path.
    """
    path = Path(path)
    if is_table(path):
        with Recordings(path) as table:
            return with_every_leak(table, inspect_recordings(table))
    with TemporaryDirectory(prefix="tactile-viewgcn-") as folder:
        file = Path(folder) / "recordings.h5"
        write_recordings(file, open_source(path), "")
        with Recordings(file) as table:
            return replace(with_every_leak(table, inspect_recordings(table)), path=path)
