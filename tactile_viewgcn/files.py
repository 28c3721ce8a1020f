"""Writes files whole or not at all, lists the files of a folder, and computes their md5."""

import errno
import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from shlex import quote
from shutil import rmtree
from tempfile import TemporaryDirectory

from tactile_viewgcn.messages import UserError

# errors for no room on the disk, for this user, or in one file
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
PART = ".unfinished"  # beginning of the name of a hidden folder in which files are written
CLONE_FILES = ("dvc.yaml", "params.yaml")  # files at the root of a clone
LOCK = "lock"  # file in the hidden folder, locked by the process that writes
MOST_READ = 100_000_000  # bytes; a page or a table that this program wrote is smaller
_md5 = partial(hashlib.md5, usedforsecurity=False)
# files that other programs leave when they look into a folder or pack it
LEFT_BEHIND = ("__MACOSX", "Thumbs.db", "desktop.ini")
VIDEO_SUFFIX = ".jpg"  # STAG's folders hold gigabytes of video frames too, which no reader reads


def root() -> Path:
    """Return the root of the repository in which `dvc` was called.

    The temporary workspaces of DVC's experiments have the same root.
    """
    return Path(os.environ.get("DVC_ROOT") or Path.cwd()).resolve()


def way_to_the_clone() -> tuple[str, str]:
    """Return what to do first if `dvc exp run` cannot work in this folder.

    Returns:
        A sentence, and the command `cd` if this folder lies in a clone. Both are empty at the root
        of a clone.
    """
    if _is_clone(Path()):
        return "", ""
    for folder in (root(), *Path.cwd().parents):
        if _is_clone(folder):
            sentence = "First go to the root of your clone of Tactile-ViewGCN."
            return sentence, f"cd {quote(str(folder))}"
    sentence = (
        "First go to the root of a clone of Tactile-ViewGCN: dvc.yaml and params.yaml lie there."
    )
    return sentence, ""


def _is_clone(folder: Path) -> bool:
    return all((folder / name).exists() for name in CLONE_FILES)


def home_path(path: str | Path) -> str:
    """Return a path whose ~ is written out as the home folder.

    Args:
        path: is returned unchanged if there is no such home folder.
    """
    try:
        return str(Path(path).expanduser())
    except RuntimeError:  # ~ of a user that does not exist
        return str(path)


def write_file(
    path: str | Path, content: str | bytes, is_own: Callable[[str], bool] | None = None
) -> None:
    """Write a file whole or not at all.

    Args:
        path: of the file.
        content: bytes, or a text that is written as UTF-8.
        is_own: tells by a file's text whether the file can be replaced. Without it any plain file
            is replaced.

    Raises:
        UserError: at `path` is something that must not be replaced.
        OSError: there is no room, or the folder is no folder.
    """
    path = Path(path)
    _check_place(path)
    if is_own and path.exists():
        _check_own(path, is_own)
    if isinstance(content, str):
        content = content.encode()
    with new_files(path.parent, path.name) as part:
        (part / path.name).write_bytes(content)


def _check_own(path: Path, is_own: Callable[[str], bool]) -> None:
    """Raise a UserError unless a file is empty, or this command wrote it and nobody edited it."""
    size = path.stat().st_size
    if size == 0:
        return
    if size > MOST_READ or not is_own(path.read_text("utf-8", errors="replace")):
        raise UserError(
            f"{path}: this file was edited, or this command did not write it; name another file "
            "or move this one away"
        )


@contextmanager
def new_files(folder: str | Path, name: str = "") -> Iterator[Path]:
    """Give an empty folder whose files take their places in `folder` at the end of the block.

    After an error no file takes its place. All else is as in `new_outputs`. A library that hides
    the error of a full disk, like torch.save, has to write into memory first.

    Args:
        folder: the folder of the files.
        name: name of the file, if there is only one; it replaces the old file in one step.

    Yields:
        The empty folder.
    """
    place = Path(folder)
    if name:
        place = place / name
    with new_outputs(place) as (made,):
        if name:
            yield made.parent
        else:
            made.mkdir()  # with the usual permissions
            yield made


@contextmanager
def new_outputs(*places: Path) -> Iterator[list[Path]]:
    """Give a path for each place, at which to write the file or folder that belongs there.

    At the end of the block all of them are put in their places together; after an error none is. A
    file that is written next to one of the paths is put next to its place.

    The files are synced first. All old files of the same names are removed before the first new
    file comes, so that files of two runs never lie side by side. Other files stay. A killed run
    leaves a hidden folder, `.unfinished...`. The next run that writes there removes it.

    Args:
        *places: paths of the files or folders.

    Yields:
        The paths to write at.

    Raises:
        UserError: the place of a file holds a link, folder, named pipe, socket or device.
        OSError: there is no room, or a folder is no folder.
    """
    made: list[Path] = []
    with ExitStack() as stack:
        try:
            for place in places:
                parent = place.parent
                if place.is_dir():
                    parent = place
                hidden = stack.enter_context(_hidden_folder(parent))
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
    """Give an empty folder in a hidden folder of `parent`.

    The hidden folder is locked as long as it is used, and then removed. Hidden folders that killed
    runs left in `parent` are removed too, since nobody holds their locks.
    """
    from filelock import FileLock  # here, since every check of parameters imports this file

    parent.mkdir(parents=True, exist_ok=True)
    for path in parent.iterdir():
        if path.name.startswith(PART):
            _remove_if_abandoned(path)
    with TemporaryDirectory(prefix=PART, dir=parent) as hidden:
        lock = FileLock(Path(hidden, "locking"))
        # on a file system without locks the folder never counts as abandoned
        with suppress(NotImplementedError):
            lock.acquire()
            Path(lock.lock_file).rename(Path(hidden, LOCK))  # so the lock appears already locked
        try:
            new = Path(hidden, "new")
            new.mkdir()
            yield new
        finally:
            lock.release()


def _remove_if_abandoned(hidden: Path) -> None:
    """Remove the hidden folder of a killed run; the folder of a run under way stays."""
    from filelock import FileLock

    lock = FileLock(hidden / LOCK)
    # it stays if it is locked, another user's, or on a file system without locks
    with suppress(OSError, NotImplementedError):
        if (hidden / LOCK).is_file():
            lock.acquire(timeout=0)
            rmtree(hidden, ignore_errors=True)
    lock.release()


def _moves(written: Path, place: Path) -> list[tuple[Path, Path]]:
    """Return pairs of what was written, at a path or next to it, and its place.

    A folder is moved as a whole if its place is free, else file by file.
    """
    moves: list[tuple[Path, Path]] = []
    for path in sorted(written.parent.iterdir()):
        target = place.parent / path.name
        if path == written:
            target = place
        if path.is_dir() and target.exists():
            moves += [(file, target / file.relative_to(path)) for file in _files_below(path)]
        else:
            moves.append((path, target))
    return moves


def _files_below(folder: Path) -> list[Path]:
    return [file for file in sorted(folder.rglob("*")) if file.is_file()]


def _take_places(moves: list[tuple[Path, Path]]) -> None:
    """Move each file or folder to its place, or none if one of them cannot be moved."""
    for path, _ in moves:
        files = [path]
        if path.is_dir():
            files = _files_below(path)
        for file in files:
            with file.open("rb+") as stream:
                os.fsync(stream)  # some file systems learn only here that a disk is full
    for path, place in moves:
        place.parent.mkdir(parents=True, exist_ok=True)
        if path.is_file():
            _check_place(place)
    if len(moves) > 1:  # a single file replaces the old file in one step
        for path, place in moves:
            if path.is_file():
                place.unlink(missing_ok=True)
    for path, place in moves:
        path.rename(place)


def _place_of(name: str | None, made: list[Path], places: tuple[Path, ...]) -> str:
    """Return the place of a file that could not be written; without a name the first place."""
    if name is None:
        return str(places[0])
    # if there was no room for one of the folders, fewer were made than places
    for written, place in zip(made, places, strict=False):
        if Path(name).is_relative_to(written.parent):
            return str(place)
    return str(name)


def _check_place(place: Path) -> None:
    """Refuse to replace anything but a plain file."""
    if place.is_symlink():
        raise UserError(
            f"{place}: this is a link; name another file, or if DVC made it: dvc unprotect {place}"
        )
    check_is_file(place)


@contextmanager
def readable(
    path: object,
    fault: str = "damaged, or not written by this version",
    remedy: str = "delete it and repeat the command",
) -> Iterator[None]:
    """Give a context in which a library reads a file, by default the file of an earlier stage.

    Keep this project's own code outside, since its faults would be blamed on the file.

    Args:
        path: names the file in messages.
        fault: what is wrong with the file if the call fails.
        remedy: what the user can do then.

    Raises:
        UserError: the library raised an exception; the message is one line with `fault` and
            `remedy`.
        MemoryError: memory does not suffice; the message names the path.
        OSError: another program holds a lock on the file.
    """
    try:
        yield
    except (UserError, ImportError, NameError):  # a file's content is never the cause of these
        raise
    except BlockingIOError as error:  # HDF5 locks a file in which it writes
        raise OSError(
            f"{path}: another program has this file open; close it there and try again"
        ) from error
    except MemoryError as error:
        raise MemoryError(f"{path}: {error}") from error
    except Exception as error:  # a damaged file fails in many ways
        first_sentence = " ".join(str(error).split()).partition(". ")[0]
        reason = f"{type(error).__name__}: {first_sentence}"
        raise UserError(f"{path}: {fault} ({reason}); {remedy}") from error


def all_below(path: Path) -> list[Path]:
    """Return all files below a folder, in the order of their paths.

    Hidden files, and files that other programs leave behind, are not among them. Links to folders
    are followed, and each folder is read once.

    Args:
        path: of the folder.

    Raises:
        OSError: a folder cannot be read.
    """
    files = list[Path]()
    known = {path.resolve()}
    for place, folders, names in os.walk(path, onerror=_fail, followlinks=True):
        files += [Path(place, name) for name in names if _is_content(name)]
        # if one folder has two names, the first is taken
        by_folder = dict[Path, str]()
        for name in sorted(filter(_is_content, folders), reverse=True):
            by_folder[Path(place, name).resolve()] = name
        folders[:] = [name for folder, name in by_folder.items() if folder not in known]
        known |= by_folder.keys()
    return sorted(files)


def _fail(error: OSError) -> None:
    raise error


def _is_content(name: str) -> bool:
    return not name.startswith(".") and name not in LEFT_BEHIND


def check_is_file(path: Path) -> None:
    """Raise a UserError if there is something other than a file at a path.

    Reading a named pipe, a socket or a device might never end.

    Args:
        path: there can be nothing at this path.

    Raises:
        UserError: at the path is a folder, named pipe, socket or device.
    """
    if path.exists() and not path.is_file():
        raise UserError(f"{path}: a folder, named pipe, socket or device; expected a file")


def md5(path: str | Path) -> str:
    """Return the md5 of a file or a folder.

    Args:
        path: of the file or folder. The md5 of a folder is computed from the sorted paths and md5s
            of all files below it, see `all_below`, without video frames.

    Raises:
        UserError: at the path is something else.
        OSError: there is nothing at the path, or it cannot be read.
    """
    path = Path(path)
    if path.is_dir():
        return _md5_of_folder(path)
    check_is_file(path)
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, _md5).hexdigest()


def _md5_of_folder(folder: Path) -> str:
    digest = _md5()
    for file in all_below(folder):
        if file.suffix != VIDEO_SUFFIX and file.is_file():
            line = f"{file.relative_to(folder).as_posix()} {md5(file)}\n"
            digest.update(line.encode(errors="surrogateescape"))
    return digest.hexdigest()
