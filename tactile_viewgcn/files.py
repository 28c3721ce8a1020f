"""Files written whole or not at all, their locks and their md5."""

import errno
import hashlib
import os
import shutil
import socket
import sys
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path

from filelock import FileLock, Timeout

from tactile_viewgcn.errors import UserError

LEAST_FREE = 2**16  # bytes; with less a disk counts as full
PART, OLD = ".unfinished", ".replaced"  # endings of what is written, and of a folder while it is replaced
HDF5, ARRAYS = (".h5", ".hdf5"), (".npy", ".npz", ".csv")  # endings of recordings
READ = (*HDF5, *ARRAYS, ".mat")
_md5 = partial(hashlib.md5, usedforsecurity=False)
VIDEO_SUFFIX = ".jpg"  # STAG's folders also hold gigabytes of video frames, which no reader reads


def root() -> Path:
    """Root of the repository that `dvc` was called in, also inside the temporary workspaces of its experiments."""
    return Path(os.environ.get("DVC_ROOT") or Path.cwd()).resolve()


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path` to write to: renamed to `path` at the end of the block, removed on an error.

    Its name is the same on every call, because torch.save writes it into the file and runs with equal seeds give
    equal bytes. What a killed run has left there is removed, and so is a link, which would lead elsewhere.

    Raises:
        UserError: `path` is a folder, a named pipe, a socket or a device.
    """
    path = Path(path)
    check_is_file(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + PART)
    part.unlink(missing_ok=True)
    try:
        with _room_for(path):
            yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: str | Path) -> Iterator[Path]:
    """A temporary empty folder beside `path`, which replaces `path` at the end of the block and is removed on an error.

    Raises:
        FileExistsError: `path` is a file or a link.
    """
    path = Path(path)
    if path.exists() and (path.is_symlink() or not path.is_dir()):
        raise FileExistsError(f"{path}: exists and is no folder; remove it or name another")
    part, old = path.with_name(path.name + PART), path.with_name(path.name + OLD)
    for stale in (part, old):
        shutil.rmtree(stale, ignore_errors=True)
    part.mkdir(parents=True)
    try:
        with _room_for(path):
            yield part
        if path.exists():
            path.replace(old)
        part.replace(path)
    finally:
        for stale in (part, old):
            shutil.rmtree(stale, ignore_errors=True)


@contextmanager
def _room_for(path: Path) -> Iterator[None]:
    """Tell of a full disk as Python does; torch, h5py and other libraries each have their own exception."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        if shutil.disk_usage(path.parent).free < LEAST_FREE:
            raise OSError(errno.ENOSPC, f"{os.strerror(errno.ENOSPC)}; make room", str(path)) from error
        raise


def readable(path: object) -> AbstractContextManager[None]:
    """Context for reading what an earlier stage wrote.

    Raises:
        UserError: the file is damaged, or of another version of the project.
    """
    return in_one_line(path, "damaged, or not written by this version", "delete it and run `dvc repro` again")


@contextmanager
def in_one_line(path: object, what: str, remedy: str) -> Iterator[None]:
    """Turn what a library raises at a file into a UserError: what is wrong with it, the reason and the remedy.

    Raises:
        MemoryError: names the path.
    """
    try:
        yield
    except (UserError, ImportError):
        raise
    except MemoryError as error:
        raise MemoryError(f"{path}: {error}") from error
    except Exception as error:  # a damaged file fails in many ways
        reason = f"{type(error).__name__}: {' '.join(str(error).split()).partition('. ')[0]}"
        raise UserError(f"{path}: {what} ({reason}); {remedy}") from error


def check_outputs(outputs: list[Path], inputs: list[Path]) -> None:
    """Raise a UserError for outputs that cannot be written, or that are inputs, before any work."""
    taken = {os.path.realpath(path) for path in inputs}
    for path in outputs:
        check_is_file(path)
        real, part = os.path.realpath(path), path.with_name(path.name + PART)
        if path.suffix.lower() in READ and any(real.startswith(f"{each}{os.sep}") for each in taken):
            raise UserError(f"{path}: it would be read as a recording; name a file in another folder")
        if {real, os.path.realpath(part)} & taken:
            raise UserError(f"{path}: it is read here, or named twice; name another file")
        taken.add(real)
        if os.path.lexists(part):
            raise UserError(f"{part}: it is in the way of {path}; remove it, or name another file")
        try:
            part.touch()
            part.unlink()
        except OSError as error:
            raise UserError(f"{path}: cannot be written ({error.strerror}); name another") from None


def files_below(path: Path, suffixes: Collection[str]) -> list[Path]:
    """The file itself, or all files below a folder in the order of their paths, of those with these endings.

    Hidden files and folders, whose names begin with a dot, are left out.

    Raises:
        UserError: folders lie in each other deeper than Python follows them: before 3.12 some hundreds.
    """
    try:
        files = sorted(path.rglob("*")) if path.is_dir() else [path]
    except RecursionError:
        raise UserError(f"{path}: folders lie too deep within each other; expected a few levels") from None
    files = [file for file in files if file.suffix.lower() in suffixes]
    return [file for file in files if not any(part.startswith(".") for part in file.relative_to(path).parts)]


def stag_files(path: Path) -> list[Path]:
    """STAG's raw recordings in a folder, in the order of their paths; hidden folders are left out."""
    return sorted(path.glob("[!.]*/[!.]*/pressuredata.mat"))


def check_is_file(path: Path) -> None:
    """Raise a UserError for a named pipe, a socket or a device, which would be waited for, or never ends."""
    if path.exists() and not path.is_file():
        raise UserError(f"{path}: a folder, named pipe, socket or device; expected a file")


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock of a file, whose text names the process that has it; one that has to wait prints this first."""
    lock = FileLock(path)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        holder = path.read_text(errors="replace").strip() or "another process"
        remedy = "end it if a killed run has left it behind"
        print(f"waits for {holder}, which has {path}; {remedy}", file=sys.stderr, flush=True)
        lock.acquire()
    try:
        path.write_text(f"process {os.getpid()} on {socket.gethostname()} ({' '.join(sys.orig_argv[1:])[:200]})\n")
        yield
    finally:
        lock.release()


def md5(path: str | Path) -> str:
    """md5 of a file, or of a folder: over paths and md5s of its files, sorted, video frames excepted."""
    path = Path(path)
    if path.is_dir():
        digest = _md5()
        for file in sorted(file for file in path.rglob("*") if file.suffix != VIDEO_SUFFIX and file.is_file()):
            digest.update(f"{file.relative_to(path).as_posix()} {md5(file)}\n".encode())
        return digest.hexdigest()
    check_is_file(path)
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, _md5).hexdigest()
