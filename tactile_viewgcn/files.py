"""Files that are written whole or not at all, and files to read: which there are, and their md5."""

import errno
import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory

from tactile_viewgcn.messages import UserError

NO_ROOM = errno.ENOSPC, errno.EDQUOT, errno.EFBIG  # on the disk, for this user, or in one file
PART = ".unfinished"  # beginning of the name of a hidden folder in which files are written
LOCK = "lock"  # file in that folder, locked by the process that writes
MOST_READ = 100_000_000  # bytes of a page or a table of ours
_md5 = partial(hashlib.md5, usedforsecurity=False)
# by programs that look into a folder or pack it
LEFT_BEHIND = ("__MACOSX", "Thumbs.db", "desktop.ini")
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


def write_file(
    path: str | Path, content: str | bytes, is_own: Callable[[str], bool] | None = None
) -> None:
    """Write a file, a text as UTF-8, whole or not at all; errors as in `new_files`.

    Args:
        is_own: whether a file with this text may be replaced; without it any plain file may.
    """
    path = Path(path)
    _check_place(path)
    size = path.stat().st_size if is_own and path.exists() else 0
    if size > MOST_READ or (
        is_own and size and not is_own(path.read_text("utf-8", errors="replace"))
    ):
        raise UserError(
            f"{path}: a file that this command has not written; remove it or name another"
        )
    with new_files(path.parent, path.name) as part:
        (part / path.name).write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def new_files(folder: str | Path, name: str = "") -> Iterator[Path]:
    """An empty folder whose files take their places in `folder` at the end of the block.

    After an error none does. Otherwise as in `new_outputs`. A library that hides a full disk's
    error, as torch.save does, has to write into memory.

    Args:
        name: of the only file, which takes the old one's place at once.
    """
    folder = Path(folder)
    place = folder / name if name else folder
    with new_outputs(place) as (made,):
        if name:
            yield made.parent
        else:
            made.mkdir()  # with the usual permissions
            yield made


@contextmanager
def new_outputs(*places: Path) -> Iterator[list[Path]]:
    """Paths at which to write files or folders, one for each place, where they are put together at the end.

    After an error nothing is put there. What is written beside one of the paths belongs beside its
    place.

    The files are synced first. All old ones of the same names go before the first new one comes, so
    that files of two runs never lie side by side; others stay. What a killed run leaves is a hidden
    folder, `.unfinished...`, which the next run that writes there removes.

    Raises:
        UserError: where a file belongs is a link, folder, named pipe, socket or device.
        OSError: there is no room, or a folder is none.
    """
    made: list[Path] = []
    with ExitStack() as stack:
        try:
            for place in places:
                hidden = stack.enter_context(
                    _hidden_folder(place if place.is_dir() else place.parent)
                )
                made.append(hidden / (place.name or "new"))
            yield made
            moves: list[tuple[Path, Path]] = []
            for written, place in zip(made, places, strict=True):
                moves += _moves(written, place)
            _take_places(moves)
        except OSError as error:
            if error.errno not in NO_ROOM:
                raise
            name = _place_of(error.filename2 or error.filename, made, places)
            raise OSError(error.errno, f"{os.strerror(error.errno)}; make room", name) from error


@contextmanager
def _hidden_folder(parent: Path) -> Iterator[Path]:
    """An empty folder in a hidden folder of `parent`, which is locked as long as it is used and then removed.

    What runs that were killed have left in `parent` is removed too: nobody holds its lock.
    """
    from filelock import FileLock  # here, since all that checks parameters imports this file

    parent.mkdir(parents=True, exist_ok=True)
    for path in parent.iterdir():
        if path.name.startswith(PART):
            _remove_if_abandoned(path)
    with TemporaryDirectory(prefix=PART, dir=parent) as hidden:
        lock = FileLock(Path(hidden, "locking"))
        # a file system without locks; the folder is then never taken for abandoned
        with suppress(NotImplementedError):
            lock.acquire()
            Path(lock.lock_file).rename(Path(hidden, LOCK))  # appears locked
        try:
            new = Path(hidden, "new")
            new.mkdir()
            yield new
        finally:
            lock.release()


def _remove_if_abandoned(hidden: Path) -> None:
    """Remove the hidden folder of a run that was killed; that of a running one stays."""
    from filelock import FileLock

    lock = FileLock(hidden / LOCK)
    # locked, another user's, or on a file system without locks
    with suppress(OSError, NotImplementedError):
        if (hidden / LOCK).is_file():
            lock.acquire(timeout=0)
            rmtree(hidden, ignore_errors=True)
    lock.release()


def _moves(written: Path, place: Path) -> list[tuple[Path, Path]]:
    """What was written at a path and beside it, each with its place; a folder as one where there is none before."""
    moves: list[tuple[Path, Path]] = []
    for path in sorted(written.parent.iterdir()):
        target = place if path == written else place.parent / path.name
        if path.is_dir() and target.exists():
            moves += [(file, target / file.relative_to(path)) for file in _files_below(path)]
        else:
            moves.append((path, target))
    return moves


def _files_below(folder: Path) -> list[Path]:
    return [file for file in sorted(folder.rglob("*")) if file.is_file()]


def _take_places(moves: list[tuple[Path, Path]]) -> None:
    """Move each file or folder to its place; nothing is moved or removed where one of them cannot be."""
    for path, _ in moves:
        for file in _files_below(path) if path.is_dir() else [path]:
            with file.open("rb+") as stream:
                os.fsync(stream)  # some file systems learn only here that a disk is full
    for path, place in moves:
        place.parent.mkdir(parents=True, exist_ok=True)
        if path.is_file():
            _check_place(place)
    if len(moves) > 1:  # a single file takes the old one's place at once
        for path, place in moves:
            if path.is_file():
                place.unlink(missing_ok=True)
    for path, place in moves:
        path.rename(place)


def _place_of(name: str | None, made: list[Path], places: tuple[Path, ...]) -> str:
    """The place that a file belongs to which could not be written; without a name the first one."""
    if name is None:
        return str(places[0])
    # fewer are made where the first had no room
    for written, place in zip(made, places, strict=False):
        if Path(name).is_relative_to(written.parent):
            return str(place)
    return str(name)


def _check_place(place: Path) -> None:
    """Refuse to replace anything but a plain file."""
    if place.is_symlink():
        raise UserError(
            f"{place}: a link; name another file, or if DVC has made it: dvc unprotect {place}"
        )
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
        raise OSError(
            f"{path}: a different program has it open; close it there and try again"
        ) from error
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
        real = {
            Path(place, name).resolve(): name
            for name in sorted(filter(_is_kept, folders), reverse=True)
        }
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
        for file in (
            file for file in all_below(path) if file.suffix != VIDEO_SUFFIX and file.is_file()
        ):
            digest.update(
                f"{file.relative_to(path).as_posix()} {md5(file)}\n".encode(
                    errors="surrogateescape"
                )
            )
        return digest.hexdigest()
    check_is_file(path)
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, _md5).hexdigest()
