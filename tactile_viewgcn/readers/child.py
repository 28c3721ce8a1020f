"""Work on a file of recordings in a child process, with limits on memory and time.

SciPy and HDF5 are not hardened: a damaged file may crash them, take all memory or never end. The process is the
boundary.
"""

import faulthandler
import os
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

from tactile_viewgcn.errors import UserError

MEMORY, MEMORY_TIMES = 2**30, 20  # bytes beyond what the program holds; times the bytes that are stored, on top
SECONDS, SECONDS_PER_MB = 10, 2  # of the processor
AGAIN = "record or download it again"


def run_apart(work: Callable[[], None], path: Path) -> None:
    """Run `work`, which reads the file or folder `path`, in a process of its own; without fork, in this one.

    Raises:
        UserError: as `work`; or it crashed, or took more memory or time than a file of that size needs.
    """
    if not hasattr(os, "fork"):
        work()
        return
    context = get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_limited, args=(work, path, sender), daemon=True)
    child.start()
    sender.close()
    try:
        error = receiver.recv()
    except EOFError:
        error = UserError(f"{path}: damaged: reading it crashed, or took too long; {AGAIN}")
    except BaseException:
        child.terminate()
        raise
    finally:
        child.join()
    if error is not None:
        raise error


def _limited(work: Callable[[], None], path: Path, sender: Connection) -> None:
    """Run `work` within the limits, and send the exception that ends it, or None."""
    import resource  # here: Windows has none

    faulthandler.disable()  # a crash is told in one line
    stored = stored_bytes(path)
    _lower(resource.RLIMIT_CPU, SECONDS + SECONDS_PER_MB * stored // 10**6)
    if (status := Path("/proc/self/statm")).exists():  # Linux; others do not hold to it
        held = int(status.read_text().split()[0]) * resource.getpagesize()
        _lower(resource.RLIMIT_AS, held + MEMORY + MEMORY_TIMES * stored)
    try:
        work()
        sender.send(None)
    except MemoryError:
        sender.send(UserError(f"{path}: reading it takes more memory than a file of that size needs; {AGAIN}"))
    except Exception as error:
        sender.send(error)


def stored_bytes(path: Path) -> int:
    """Size of a file, or of all files below a folder."""
    return sum(file.stat().st_size for file in (path.rglob("*") if path.is_dir() else [path]) if file.is_file())


def _lower(kind: int, limit: int) -> None:
    import resource

    _, most = resource.getrlimit(kind)
    resource.setrlimit(kind, (limit if most == resource.RLIM_INFINITY else min(limit, most), most))
