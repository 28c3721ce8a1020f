"""Reading files of recordings in a child process, with limits on memory and time.

A damaged file may crash SciPy or HDF5, make them take all memory or keep them busy for ever. That ends the child alone.
"""

import faulthandler
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import current_process, get_context
from multiprocessing.connection import Connection
from pathlib import Path
from traceback import format_exc

from tactile_viewgcn.files import READ, check_is_file, files_below, in_one_line, stag_files
from tactile_viewgcn.messages import UserError

MEMORY, MEMORY_TIMES = 2**30, 20  # bytes on top of the program's own; and on top of these, times the source's size
SECONDS, SECONDS_PER_MB = 10, 2  # of processor time; for each MB of the source, on top
_parents: list[Connection] = []  # in the child: the connection to its parent


def run_apart(work: Callable[[], None], path: Path) -> None:
    """Run `work`, which reads the file or folder `path`, in a child process; where none can be forked, in this one.

    Raises:
        UserError: as `work`; or it crashed, or took more memory or time than a source of that size needs.
    """
    if not hasattr(os, "fork") or current_process().daemon:
        work()
        return
    context = get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_limited, args=(work, stored_bytes(path), sender), daemon=True)
    child.start()
    sender.close()
    try:
        while isinstance(message := receiver.recv(), Path):
            path = message
    except EOFError:
        child.join()
        what = "took too long" if child.exitcode == -signal.SIGXCPU else "crashed"
        message = UserError(f"{path}: reading it {what}; record or download again what is damaged")
    finally:
        child.kill()
        child.join()
    if isinstance(message, MemoryError):
        message = UserError(
            f"{path}: reading it takes more memory than a file of its size may ({message}); save it uncompressed"
        )
    if message is not None:
        raise message


@contextmanager
def reading(file: Path) -> Iterator[None]:
    """Context for reading a file of recordings: errors of libraries, and a crash of the process, name the file.

    Raises:
        UserError: it is not a regular file, or it is damaged.
    """
    for parent in _parents:
        parent.send(file)
    check_is_file(file)
    with in_one_line(file, "damaged, cut short or of another form", "record, save or download it again"):
        yield


def _limited(work: Callable[[], None], stored: int, parent: Connection) -> None:
    """Run `work` within the limits for `stored` bytes, and send the parent the exception that ended it, or None."""
    import resource  # here, since Windows has none

    _parents.append(parent)
    faulthandler.disable()  # the parent reports a crash in one line
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_DFL)
    limits = {resource.RLIMIT_CPU: SECONDS + SECONDS_PER_MB * stored // 10**6}
    if (status := Path("/proc/self/statm")).exists():  # on Linux; other systems do not keep the limit
        in_use = int(status.read_text().split()[0]) * resource.getpagesize()
        limits[resource.RLIMIT_AS] = in_use + MEMORY + MEMORY_TIMES * stored
    for kind, limit in limits.items():
        lower = [old for old in resource.getrlimit(kind) if old != resource.RLIM_INFINITY]
        resource.setrlimit(kind, (min([limit, *lower]), resource.getrlimit(kind)[1]))
    try:
        work()
    except Exception as error:
        error.add_note(format_exc())
        parent.send(_sendable(error))
    else:
        parent.send(None)


def _sendable(error: Exception) -> Exception:
    """The error itself, or a RuntimeError with its text where it cannot be pickled."""
    try:
        return pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")


def stored_bytes(path: Path) -> int:
    """Size of a file, or of all recordings below a folder, in bytes."""
    files = [path] if path.is_file() else {*files_below(path, READ), *stag_files(path)}
    return sum(file.stat().st_size for file in files if file.is_file())
