"""Read files of recordings in a child process, with limits on memory, time and size.

A damaged file can crash SciPy or HDF5, make them fill the memory, or keep them busy for ever. That
ends only the child. The child gets its request as JSON. It prints as JSON each file that it reads,
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

MEMORY = 2**30  # bytes of memory besides the program's own
MEMORY_TIMES = 20  # more bytes for each byte of the source
SECONDS = 10  # seconds of CPU time
SECONDS_PER_MB = 2  # more seconds for each MB of the source
TABLE = 2**30  # bytes of the table
TABLE_TIMES = 200  # more bytes for each byte of the source
UNPACKED = 2**27  # bytes that a file may unpack to
UNPACKED_TIMES = 50  # more bytes for each of its bytes
LFS = b"version https://git-lfs.github.com/spec/"  # the first bytes of a placeholder
# the exceptions that the parent raises, by the kind of the child's message
RAISED = {"UserError": UserError, "OSError": OSError, "fault": RuntimeError}
PACKAGES = Path(__file__).parents[2]  # the folder in which the child finds this package
_parents: list[TextIO] = []  # the stream to the parent, if this process is the child


def run_apart(module: str, request: dict[str, Any], path: Path) -> None:
    """Run `python -m module`, which calls `serve` and reads the file or folder `path`.

    Args:
        module: the name of the module.
        path: the path of the source. The error of a crash names the file that was read last.
        request: plain values for the function that the module serves.

    Raises:
        UserError: the function raised it. Or it crashed, or took more memory or time than is
            allowed for a source of that size.
        OSError: the function raised it.
        RuntimeError: the function raised any other exception, whose traceback is the text.
    """
    words = json.dumps(request | {"memory": MEMORY, "seconds": SECONDS})
    places = str(PACKAGES)
    if os.environ.get("PYTHONPATH"):
        places += os.pathsep + os.environ["PYTHONPATH"]
    child = subprocess.run(
        # -P, since a user's folder can hold files with the names of modules
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
    kind = message.get("kind")
    args = message.get("args", [])
    if kind in RAISED:
        raise RAISED[kind](*args)
    if kind == "done":
        return
    what = "reading it crashed; if it is damaged, record or download it again"
    if child.returncode == -signal.SIGXCPU:
        what = "reading it took too long; if it is damaged, record or download it again"
    if kind == "MemoryError":
        what = "reading it takes more memory than is allowed for its size "
        what += f"({args[0]}); save it uncompressed"
    raise UserError(f"{path}: {what}")


def serve(work: Callable[[dict[str, Any]], None]) -> None:
    """Call `work` in the child with the request, and tell the parent how it ended."""
    parent = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # a C library prints to 1, whatever sys.stdout is
    _parents.append(parent)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    message: dict[str, Any] = {"kind": "done"}
    try:
        work(json.loads(sys.argv[1]))
    except UserError as error:
        message = {"kind": "UserError", "args": [str(error)]}
    except MemoryError as error:
        message = {"kind": "MemoryError", "args": [str(error)]}
    except OSError as error:
        args = list(error.args[:2])
        if error.filename:
            args.append(str(error.filename))
        message = {"kind": "OSError", "args": args}
    except Exception:
        message = {"kind": "fault", "args": [traceback.format_exc()]}
    print(json.dumps(message), file=parent, flush=True)


def system_limits() -> dict[int, tuple[int, int]]:
    """Return the soft and hard limits that the system set for this process, by their kinds."""
    kinds = (resource.RLIMIT_CPU, resource.RLIMIT_FSIZE, resource.RLIMIT_AS)
    return {kind: resource.getrlimit(kind) for kind in kinds}


def limit(
    request: dict[str, Any], stored: int, system: dict[int, tuple[int, int]] | None = None
) -> None:
    """Set the limits of a request in the child, if the system has such limits.

    Args:
        request: the request, with its bytes of `memory` and its `seconds`.
        stored: the bytes of the source.
        system: limits from `system_limits`, which are not exceeded. None stands for the present
            limits of this process.
    """
    seconds = request["seconds"] + SECONDS_PER_MB * stored // 10**6
    limits = {
        resource.RLIMIT_CPU: int(time.process_time()) + seconds,
        resource.RLIMIT_FSIZE: TABLE + TABLE_TIMES * stored,
    }
    status = Path("/proc/self/statm")
    if status.exists():  # only Linux enforces this limit
        in_use = int(status.read_text().split()[0]) * resource.getpagesize()
        limits[resource.RLIMIT_AS] = in_use + request["memory"] + MEMORY_TIMES * stored
    for kind, most in limits.items():
        soft, hard = (system or system_limits())[kind]
        if soft != resource.RLIM_INFINITY:
            most = min(most, soft)
        resource.setrlimit(kind, (most, hard))


@contextmanager
def reading(file: Path) -> Iterator[None]:
    """Enclose all work on a file of recordings, so that the error of a crash names it.

    Raises:
        UserError: the path is no file, or it is a placeholder of a file that is kept elsewhere.
    """
    for parent in _parents:
        print(json.dumps({"file": str(file)}), file=parent, flush=True)
    check_is_file(file)
    _check_link(file)
    try:
        yield
    except UserError:
        _check_is_no_placeholder(file)
        raise


def _check_link(file: Path) -> None:
    """Raise a UserError for a dead link."""
    if file.is_symlink() and not file.exists():
        what = f"this is a link to {file.readlink()}, which is not there"
        raise UserError(f"{file}: {what}; if git-annex keeps it: git annex get .")


def _check_is_no_placeholder(file: Path) -> None:
    """Raise a UserError if a file that could not be read is a placeholder of Git LFS."""
    with file.open("rb") as stream:
        beginning = stream.read(len(LFS))
    if beginning == LFS:
        remedy = "to fetch it: git lfs pull"
        raise UserError(f"{file}: a placeholder of Git LFS, not the recording; {remedy}") from None


def library(file: Path) -> AbstractContextManager[None]:
    """Enclose the call of a library that reads a file, so that its errors name the file.

    Only the call stands inside. An error in our own code is a fault of the program, and keeps its
    traceback.
    """
    return readable(
        file, "damaged, cut short or of another form", "record, save or download it again"
    )


def check_unpacked(file: Path, unpacked: int, stored: int | None = None) -> None:
    """Refuse a file that declares far more bytes than it stores, before they are read.

    Args:
        file: the path of the file or of the source.
        unpacked: the bytes of its arrays or of its text in memory.
        stored: the bytes on disk; None for the size of the file.

    Raises:
        UserError: it unpacks to more than `UNPACKED` bytes plus `UNPACKED_TIMES` its size.
    """
    if stored is None:
        stored = file.stat().st_size
    most = UNPACKED + UNPACKED_TIMES * stored
    if unpacked > most:
        raise UserError(
            f"{file}: {stored:,} bytes unpack to more than {most:,} bytes, which can "
            "fill the memory; save it uncompressed"
        )
