"""Work on files of recordings in a child process, with limits on memory and time.

SciPy and HDF5 are not hardened: a damaged file may crash them, take all memory or never end. The process is the
boundary.
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

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import READ, check_is_file, files_below, in_one_line, stag_files

MEMORY, MEMORY_TIMES = 2**30, 20  # bytes beyond what the program holds; times the bytes that are stored, on top
SECONDS, SECONDS_PER_MB = 10, 2  # of the processor
_parents: list[Connection] = []  # in the child: where it says which file it reads


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
            f"{path}: reading it takes more memory than its size lets expect ({message}); save it uncompressed"
        )
    if message is not None:
        raise message


@contextmanager
def reading(file: Path) -> Iterator[None]:
    """Context for reading a file from outside, which names it where a library fails, or the process ends.

    Raises:
        UserError: it is no file, or damaged.
    """
    for parent in _parents:
        parent.send(file)
    check_is_file(file)
    with in_one_line(file, "damaged, cut short or of another form", "record, save or download it again"):
        yield


def _limited(work: Callable[[], None], stored: int, parent: Connection) -> None:
    """Run `work` within the limits for so many bytes stored, and send the exception that ends it, or None."""
    import resource  # here: Windows has none

    _parents.append(parent)
    faulthandler.disable()  # a crash is told in one line
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_DFL)
    limits = {resource.RLIMIT_CPU: SECONDS + SECONDS_PER_MB * stored // 10**6}
    if (status := Path("/proc/self/statm")).exists():  # Linux; others do not hold to it
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
    """The error itself, or its text where it cannot be pickled."""
    try:
        return pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")


def stored_bytes(path: Path) -> int:
    """Size of the files that readers read: a file's own, or of all recordings below a folder."""
    files = [path] if path.is_file() else {*files_below(path, READ), *stag_files(path)}
    return sum(file.stat().st_size for file in files if file.is_file())
