"""Reading files of recordings in a separate process, with limits on memory, time and size.

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

MEMORY = 2**30  # bytes on top of the program's own
MEMORY_TIMES = 20  # the same for each byte of the source
SECONDS = 10  # of processor time
SECONDS_PER_MB = 2  # the same for each MB of the source
TABLE = 2**30  # bytes of the table
TABLE_TIMES = 200  # the same for each byte of the source
UNPACKED = 2**27  # bytes that a file may unpack to
UNPACKED_TIMES = 50  # the same for each of its bytes
LFS = b"version https://git-lfs.github.com/spec/"  # beginning of a placeholder
# in the parent, by kind
RAISED = {"UserError": UserError, "OSError": OSError, "fault": RuntimeError}
PACKAGES = Path(__file__).parents[2]  # where the child finds this package
_parents: list[TextIO] = []  # in the child: the stream to its parent


def run_apart(module: str, request: dict[str, Any], path: Path) -> None:
    """Run `python -m module`, which calls `serve` and reads the file or folder `path`.

    Args:
        module: name of the module.
        path: of the source; a crash names the file that was read last.
        request: plain values for the function that the module serves.

    Raises:
        UserError: as that function; or it crashed, or took more memory or time than a source of
            that size needs.
        OSError: as that function.
        RuntimeError: any other exception, with its traceback as text.
    """
    words = json.dumps(request | {"memory": MEMORY, "seconds": SECONDS})
    places = str(PACKAGES)
    if os.environ.get("PYTHONPATH"):
        places += os.pathsep + os.environ["PYTHONPATH"]
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
    kind = message.get("kind")
    args = message.get("args", [])
    if kind in RAISED:
        raise RAISED[kind](*args)
    if kind == "done":
        return
    what = "reading it crashed; record or download again what is damaged"
    if child.returncode == -signal.SIGXCPU:
        what = "reading it took too long; record or download again what is damaged"
    if kind == "MemoryError":
        what = "reading it takes more memory than a file of its size may "
        what += f"({args[0]}); save it uncompressed"
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
    """Return the limits of this process, soft and hard, by their kinds, as the system set them."""
    kinds = (resource.RLIMIT_CPU, resource.RLIMIT_FSIZE, resource.RLIMIT_AS)
    return {kind: resource.getrlimit(kind) for kind in kinds}


def limit(
    request: dict[str, Any], stored: int, system: dict[int, tuple[int, int]] | None = None
) -> None:
    """In the child: set the limits of a request, where the system has such limits.

    Args:
        request: its bytes of `memory` and its `seconds`.
        stored: bytes of the source.
        system: limits that are kept, from `system_limits`; None: those of this process by now.
    """
    seconds = request["seconds"] + SECONDS_PER_MB * stored // 10**6
    limits = {
        resource.RLIMIT_CPU: int(time.process_time()) + seconds,
        resource.RLIMIT_FSIZE: TABLE + TABLE_TIMES * stored,
    }
    status = Path("/proc/self/statm")
    if status.exists():  # on Linux; other systems do not keep the limit
        in_use = int(status.read_text().split()[0]) * resource.getpagesize()
        limits[resource.RLIMIT_AS] = in_use + request["memory"] + MEMORY_TIMES * stored
    for kind, most in limits.items():
        soft, hard = (system or system_limits())[kind]
        if soft != resource.RLIM_INFINITY:
            most = min(most, soft)
        resource.setrlimit(kind, (most, hard))


@contextmanager
def reading(file: Path) -> Iterator[None]:
    """Context of all that is done with a file of recordings: a crash of the child names it.

    Raises:
        UserError: it is no file, or something stands in place of a file that is kept elsewhere.
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
        what = f"a link to {file.readlink()}, which is not there"
        raise UserError(f"{file}: {what}; if Git annex keeps it: git annex get .")


def _check_is_no_placeholder(file: Path) -> None:
    """Raise a UserError for a text of Git LFS; called for a file that could not be read."""
    with file.open("rb") as stream:
        beginning = stream.read(len(LFS))
    if beginning == LFS:
        remedy = "bring it: git lfs pull"
        raise UserError(f"{file}: a placeholder of Git LFS, not the recording; {remedy}") from None


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
        file: its path, or that of the source.
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
            f"{file}: {stored:,} bytes unpack to {unpacked:,} bytes; expected at most {most:,}, "
            "since more may fill the memory; save it uncompressed"
        )
