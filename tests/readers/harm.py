"""Do what a damaged file can make a library do, in the child process that reads files.

See `readers.child`.
"""

import errno
import os
from itertools import repeat
from pathlib import Path

import numpy as np

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.child import limit, reading, serve

HARMS = {
    "crash": os.abort,
    "memory": lambda: np.ones(2**32),
    "time": lambda: all(repeat(True)),
    "words of a library": lambda: os.write(1, b"libhdf5: a line\n"),
    "mistake": lambda: fail(UserError("a mistake")),
    "full disk": lambda: fail(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))),
    "fault": lambda: 1 // 0,
    "fault while a file is read": lambda: 1 // 0,
}


def fail(error):
    raise error


def work(request):
    limit(request | {"seconds": 1}, 0)
    if request["harm"] in ("fault", "full disk"):
        HARMS[request["harm"]]()
    with reading(Path(request["file"])):
        HARMS[request["harm"]]()


if __name__ == "__main__":
    serve(work)
