"""A disk without room, by the operating system's limit on the size of a file.

The limit needs neither root nor a mount, and is exact to the byte. A write beyond it raises an
OSError, as on a full disk.
"""

from contextlib import contextmanager

import pytest


@contextmanager
def room_for(size):
    """Limit the size of each file to `size` bytes while the context lasts."""
    resource = pytest.importorskip(
        "resource", reason="this system has no limit on the size of a file"
    )
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (max(0, size), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
