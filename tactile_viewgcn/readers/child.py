"""Reading files of recordings in a separate process, with limits on memory, time and the size of its table.

A damaged file may crash SciPy or HDF5, make them fill the memory or keep them busy for ever. That
ends the child alone. The child gets its request as JSON and prints JSON: the file that it reads,
and the error that ended it.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, TextIO

from tactile_viewgcn.files import check_is_file, readable
from tactile_viewgcn.messages import UserError

# bytes on top of the program's own; and on top of these, times the source's size
MEMORY, MEMORY_TIMES = 2**30, 20
SECONDS, SECONDS_PER_MB = 10, 2  # of processor time; for each MB of the source, on top
TABLE, TABLE_TIMES = 2**30, 200  # bytes of the table, and on top times the source's size
UNPACKED, UNPACKED_TIMES = 2**27, 50  # bytes that a file may unpack to, and on top times its size
LFS = b"version https://git-lfs.github.com/spec/"  # beginning of a placeholder
# in the parent, by kind
RAISED = {"UserError": UserError, "OSError": OSError, "fault": RuntimeError}
PACKAGES = Path(__file__).parents[2]  # where the child finds this package
_parents: list[TextIO] = []  # in the child: the stream to its parent


def run_apart(module: str, request: dict[str, Any], path: Path) -> None:
    """Run `python -m module`, which calls `serve` and reads the file or folder `path`.

    Args:
        request: plain values for the function that the module serves.

    Raises:
        UserError: as that function; or it crashed, or took more memory or time than a source of
            that size needs.
        OSError: as that function.
        RuntimeError: any other exception, with its traceback as text.
    """
    words = json.dumps(request | {"memory": MEMORY, "seconds": SECONDS})
    places = os.pathsep.join([str(PACKAGES), *filter(None, [os.environ.get("PYTHONPATH")])])
    child = subprocess.run(
        # -P: a user's folder may hold files called like modules
        [sys.executable, "-P", "-m", module, words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": places},
        check=False,
    )
    message: dict[str, Any] = {}
    for line in child.stdout.splitlines():
        message = json.loads(line)
        path = Path(message.get("file", path))
    kind, args = message.get("kind"), message.get("args", [])
    if kind in RAISED:
        raise RAISED[kind](*args)
    slow = child.returncode == -signal.SIGXCPU
    what = f"reading it {'took too long' if slow else 'crashed'}; record or download again what is damaged"
    if kind == "MemoryError":
        what = f"reading it takes more memory than a file of its size may ({args[0]}); save it uncompressed"
    if kind != "done":
        raise UserError(f"{path}: {what}")


def serve(work: Callable[[dict[str, Any]], None]) -> None:
    """In the child: call `work` with the request, and tell the parent how it ended."""
    parent = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # a library written in C prints to 1 whatever sys.stdout is
    _parents.append(parent)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    message: dict[str, Any] = {"kind": "done"}
    try:
        work(json.loads(sys.argv[1]))
    except (UserError, MemoryError) as error:
        message = {"kind": type(error).__name__, "args": [str(error)]}
    except OSError as error:
        message = {
            "kind": "OSError",
            "args": [*error.args[:2], *map(str, filter(None, [error.filename]))],
        }
    except Exception:
        message = {"kind": "fault", "args": [traceback.format_exc()]}
    print(json.dumps(message), file=parent, flush=True)


def limit(request: dict[str, Any], stored: int) -> None:
    """In the child: set the limits of a request for a source of `stored` bytes, where the system has such limits."""
    limits = {
        resource.RLIMIT_CPU: int(time.process_time())
        + request["seconds"]
        + SECONDS_PER_MB * stored // 10**6,
        resource.RLIMIT_FSIZE: TABLE + TABLE_TIMES * stored,
    }
    # on Linux; other systems do not keep the limit
    if (status := Path("/proc/self/statm")).exists():
        in_use = int(status.read_text().split()[0]) * resource.getpagesize()
        limits[resource.RLIMIT_AS] = in_use + request["memory"] + MEMORY_TIMES * stored
    for kind, most in limits.items():
        soft, hard = resource.getrlimit(kind)
        resource.setrlimit(
            kind, (most if soft == resource.RLIM_INFINITY else min(most, soft), hard)
        )


@contextmanager
def reading(file: Path) -> Iterator[None]:
    """Context of all that is done with a file of recordings: a crash of the child names it; refuses what is no file."""
    for parent in _parents:
        print(json.dumps({"file": str(file)}), file=parent, flush=True)
    check_is_file(file)
    check_is_there(file)
    yield


def check_is_there(file: Path) -> None:
    """Raise a UserError for what stands in place of a file that is kept elsewhere: a dead link, a text of Git LFS."""
    if file.is_symlink() and not file.exists():
        what = f"a link to {file.readlink()}, which is not there"
        raise UserError(f"{file}: {what}; if Git annex keeps it: git annex get .")
    with file.open("rb") as stream:
        if stream.read(len(LFS)) == LFS:
            raise UserError(
                f"{file}: a placeholder of Git LFS, not the recording; bring it: git lfs pull"
            )


def library(file: Path) -> AbstractContextManager[None]:
    """Context of a library's call that reads a file of recordings: its errors name the file.

    Only the call stands inside. An error of our own code is a fault of the program and keeps its
    traceback.
    """
    return readable(
        file, "damaged, cut short or of another form", "record, save or download it again"
    )


def check_unpacked(file: Path, unpacked: int, stored: int | None = None) -> None:
    """Refuse a file that declares far more bytes than it stores, before they are read.

    Args:
        unpacked: bytes of its arrays or of its text in memory.
        stored: bytes on the disk; those of the file where they are not given.

    Raises:
        UserError: it unpacks to more than `UNPACKED` and `UNPACKED_TIMES` its size.
    """
    if stored is None:
        stored = file.stat().st_size
    most = UNPACKED + UNPACKED_TIMES * stored
    if unpacked > most:
        raise UserError(
            f"{file}: {stored:,} bytes unpack to {unpacked:,} bytes; expected at most {most:,}, since more may fill "
            "the memory; save it uncompressed"
        )
