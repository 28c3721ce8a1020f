"""Files that are written whole or not at all, and files to read: which there are, and their md5."""

import errno
import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from tactile_viewgcn.messages import UserError

NO_ROOM = errno.ENOSPC, errno.EDQUOT, errno.EFBIG  # on the disk, for this user, or in one file
PART = ".unfinished"  # beginning of the name of a hidden folder in which files are written
MOST_READ = 100_000_000  # bytes of a page or a table of ours
_md5 = partial(hashlib.md5, usedforsecurity=False)
LEFT_BEHIND = ("__MACOSX", "Thumbs.db", "desktop.ini")  # by programs that look into a folder or pack it
VIDEO_SUFFIX = ".jpg"  # STAG's folders hold gigabytes of video frames too, which no reader reads


def root() -> Path:
    """Root of the repository in which `dvc` was called, also inside the temporary workspaces of its experiments."""
    return Path(os.environ.get("DVC_ROOT") or Path.cwd()).resolve()


def home_path(path: str | Path) -> str:
    """A path whose ~ is written out as the home folder; as it is where there is no such folder."""
    try:
        return str(Path(path).expanduser())
    except RuntimeError:  # ~ of nobody
        return str(path)


def write_file(path: str | Path, content: str | bytes, is_own: Callable[[str], bool] | None = None) -> None:
    """Write a file, a text as UTF-8, whole or not at all; errors as in `new_files`.

    Args:
        is_own: whether a file with this text may be replaced; without it any plain file may.
    """
    path = Path(path)
    _check_place(path)
    size = path.stat().st_size if is_own and path.exists() else 0
    if size > MOST_READ or (is_own and size and not is_own(path.read_text("utf-8", errors="replace"))):
        raise UserError(f"{path}: a file that this command has not written; remove it or name another")
    with new_files(path.parent, path.name) as part:
        (part / path.name).write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def new_files(folder: str | Path, name: str = "") -> Iterator[Path]:
    """An empty folder whose files take their places in `folder` at the end of the block; after an error none does.

    The files are synced first. All old ones of the same names go before the first new one comes, so that files of two
    runs never lie side by side; others stay. What a killed run leaves is a hidden folder, `.unfinished...`. A library
    that hides a full disk's error, as torch.save does, has to write into memory.

    Args:
        name: of the only file, which takes the old one's place at once.

    Raises:
        UserError: where a file belongs is a link, folder, named pipe, socket or device.
        OSError: there is no room, or `folder` is none.
    """
    folder = Path(folder)
    try:
        (folder if name else folder.parent).mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=PART, dir=folder if folder.exists() else folder.parent) as hidden:
            (part := Path(hidden, "new")).mkdir()  # with the usual permissions
            yield part
            files = [file for file in part.rglob("*") if file.is_file()]
            for file in files:
                with file.open("rb+") as stream:
                    os.fsync(stream)  # some file systems learn only here that a disk is full
            if not folder.exists():
                part.rename(folder)
                return
            places = [folder / file.relative_to(part) for file in files]
            for place in places:
                place.parent.mkdir(parents=True, exist_ok=True)
                _check_place(place)
            for place in () if name else places:
                place.unlink(missing_ok=True)
            for file, place in zip(files, places, strict=True):
                file.rename(place)
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        raise OSError(error.errno, f"{error.strerror}; make room", error.filename or str(folder / name)) from error


def _check_place(place: Path) -> None:
    """Refuse to replace anything but a plain file."""
    if place.is_symlink():
        raise UserError(f"{place}: a link; name another file, or if DVC has made it: dvc unprotect {place}")
    check_is_file(place)


@contextmanager
def readable(
    path: object,
    fault: str = "damaged, or not written by this version",
    remedy: str = "delete it and repeat the command",
) -> Iterator[None]:
    """Context of a library's call that reads a file, by default of an earlier stage.

    Code of ours belongs outside: its faults would be blamed on the file.

    Raises:
        UserError: one line with `fault` and `remedy`, for any exception of a library that reads it.
        MemoryError: names the path.
        OSError: a different program holds a lock on the file.
    """
    try:
        yield
    except (UserError, ImportError, NameError):  # no content of a file lacks a name of our code
        raise
    except BlockingIOError as error:  # HDF5 locks a file in which it writes
        raise OSError(f"{path}: a different program has it open; close it there and try again") from error
    except MemoryError as error:
        raise MemoryError(f"{path}: {error}") from error
    except Exception as error:  # a damaged file fails in many ways
        reason = f"{type(error).__name__}: {' '.join(str(error).split()).partition('. ')[0]}"
        raise UserError(f"{path}: {fault} ({reason}); {remedy}") from error


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
