"""Files that are written whole or not at all, and files to read: which there are, and their md5."""

import errno
import hashlib
import os
import shutil
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path

from tactile_viewgcn.messages import UserError

NO_ROOM = errno.ENOSPC, errno.EDQUOT, errno.EFBIG  # on the disk, for this user, or in one file
PART = ".unfinished"  # ending of a file or folder that is being written
_md5 = partial(hashlib.md5, usedforsecurity=False)
LEFT_BEHIND = ("__MACOSX", "Thumbs.db", "desktop.ini")  # by programs that look into a folder or pack it
VIDEO_SUFFIX = ".jpg"  # STAG's folders hold gigabytes of video frames too, which no reader reads


def root() -> Path:
    """Root of the repository in which `dvc` was called, also inside the temporary workspaces of its experiments."""
    return Path(os.environ.get("DVC_ROOT") or Path.cwd()).resolve()


@contextmanager
def atomic_write(path: str | Path, *, folder: bool = False) -> Iterator[Path]:
    """A temporary path beside `path`: it takes the place of `path` at the end of the block and is removed on an error.

    The file is synced before it takes that place. What a killed run has left under that name is removed. A library that
    hides a full disk's error, as torch.save does, has to write into memory.

    Args:
        folder: the temporary path is an empty folder, else a file that the block writes.

    Raises:
        UserError: `path` is of another kind, such as a named pipe.
        OSError: there is no room.
    """
    path = Path(path)
    if not folder:
        check_is_file(path)
    elif path.exists() and (path.is_symlink() or not path.is_dir()):
        raise UserError(f"{path}: exists and is no folder; remove it or name another")
    part = path.with_name(path.name + PART)
    remove = partial(shutil.rmtree, ignore_errors=True) if folder else partial(Path.unlink, missing_ok=True)
    remove(part)
    (part if folder else path.parent).mkdir(parents=True, exist_ok=not folder)
    try:
        yield part
        for file in filter(Path.is_file, part.rglob("*") if folder else [part]):
            with file.open("rb+") as stream:
                os.fsync(stream)  # some file systems learn only here that a disk is full
        if folder:
            remove(path)
        part.replace(path)
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        raise OSError(error.errno, f"{error.strerror}; make room", str(path)) from error
    finally:
        remove(part)


def readable(path: object) -> AbstractContextManager[None]:
    """Context for reading a file of an earlier stage.

    Raises:
        UserError: the file is damaged, or of another version of the project.
    """
    return in_one_line(path, "damaged, or not written by this version", "delete it and repeat the command")


@contextmanager
def in_one_line(path: object, what: str, remedy: str) -> Iterator[None]:
    """Turn any exception of a library that reads a file into a UserError of one line.

    Args:
        what: what is wrong with the file.

    Raises:
        MemoryError: names the path.
        OSError: a different program holds a lock on the file.
    """
    try:
        yield
    except (UserError, ImportError):
        raise
    except BlockingIOError as error:  # HDF5 locks a file in which it writes
        raise OSError(f"{path}: a different program has it open; close it there and try again") from error
    except MemoryError as error:
        raise MemoryError(f"{path}: {error}") from error
    except Exception as error:  # a damaged file fails in many ways
        reason = f"{type(error).__name__}: {' '.join(str(error).split()).partition('. ')[0]}"
        raise UserError(f"{path}: {what} ({reason}); {remedy}") from error


def all_below(path: Path) -> list[Path]:
    """All files below a folder in the order of their paths, without hidden ones and what programs leave behind.

    Links to folders are followed, each folder once.

    Raises:
        OSError: a folder cannot be read.
    """

    def fail(error: OSError) -> None:
        raise error

    files, known = list[Path](), {path.resolve()}
    for place, folders, names in os.walk(path, onerror=fail, followlinks=True):
        files += [Path(place, name) for name in names if _is_kept(name)]
        real = {Path(place, name).resolve(): name for name in sorted(filter(_is_kept, folders), reverse=True)}
        folders[:] = [name for folder, name in real.items() if folder not in known]
        known |= real.keys()
    return sorted(files)


def _is_kept(name: str) -> bool:
    return not name.startswith(".") and name not in LEFT_BEHIND


def check_is_file(path: Path) -> None:
    """Raise a UserError for a folder, and for a named pipe, socket or device, whose reading may never end."""
    if path.exists() and not path.is_file():
        raise UserError(f"{path}: a folder, named pipe, socket or device; expected a file")


def md5(path: str | Path) -> str:
    """md5 of a file, or of a folder: of the sorted paths and md5s of `all_below` it, without video frames."""
    path = Path(path)
    if path.is_dir():
        digest = _md5()
        for file in (file for file in all_below(path) if file.suffix != VIDEO_SUFFIX and file.is_file()):
            digest.update(f"{file.relative_to(path).as_posix()} {md5(file)}\n".encode(errors="surrogateescape"))
        return digest.hexdigest()
    check_is_file(path)
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, _md5).hexdigest()
