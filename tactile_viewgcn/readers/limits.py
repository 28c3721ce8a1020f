"""How much a file of recordings may declare, so that a small one does not become hours of work and a full disk."""

import shutil
from pathlib import Path

from tactile_viewgcn.errors import UserError

ANY = 64 * 2**20  # bytes that every file may declare
MOST_TIMES = 200  # what it stores: noise of sensors is compressed 3 to 20 times, nothing but zeros 1,032 times by gzip
MOST_MORE = 8 * 2**30  # bytes beyond what it stores
AGAIN = "save what was recorded again, uncompressed"
COLUMN_BYTES = 32  # of the table's columns, for each frame


def most_declared(stored: int) -> int:
    """The most bytes that a file which stores so many may declare."""
    return max(ANY, min(MOST_TIMES * stored, stored + MOST_MORE))


def check_size(declared: int, stored: int, where: str, remedy: str = AGAIN) -> None:
    """Raise a UserError, whose message begins with `where`, for more bytes than `most_declared` of those stored."""
    if declared > (most := most_declared(stored)):
        raise UserError(
            f"{where} declares {declared / 1e6:,.0f} MB and stores {stored / 1e6:,.3f} MB; expected at most "
            f"{most / 1e6:,.0f} MB: {remedy}"
        )


def check_disk(folder: Path, needed: int, path: Path) -> None:
    """Raise a UserError where the disk of a folder has no room for a table of so many bytes of the source `path`."""
    usage = shutil.disk_usage(folder)
    if needed > usage.free and usage.total:  # some mounted folders do not know
        raise UserError(
            f"{path}: its table needs {needed / 1e6:,.0f} MB in {folder}, where {usage.free / 1e6:,.0f} MB are free; "
            "make room, or name another disk (TMPDIR for a temporary table)"
        )
