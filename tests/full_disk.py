"""A disk without room, for tests: the operating system's limit on the size of a file.

It needs neither root nor a mount, is exact to the byte, and fails a write on the same road as a full disk.
"""

from contextlib import contextmanager

import h5py
import pytest

SHORT = pytest.mark.parametrize("short", [1, 4, 16, 64], ids="{} KB short".format)


@contextmanager
def room_for(size):
    """A context in which no file grows beyond `size` bytes, and which leaves no HDF5 file open.

    An HDF5 file that is open when the process ends makes it crash where that file cannot be written.
    """
    resource = pytest.importorskip("resource", reason="this system has no limit on the size of a file")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (max(0, size), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_FILE) == 0
