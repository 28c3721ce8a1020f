"""A disk without room, for tests: the operating system's limit on the size of a file.

It needs neither root nor a mount, is exact to the byte, and fails a write on the same road as a
full disk.
"""

from contextlib import contextmanager

import pytest


@contextmanager
def room_for(size):
    """A context in which no file grows beyond `size` bytes."""
    resource = pytest.importorskip(
        "resource", reason="this system has no limit on the size of a file"
    )
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (max(0, size), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
