"""Files that appear whole or not at all, and their md5."""

import hashlib
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from pickle import UnpicklingError

RECORDINGS = (".mat", ".h5", ".hdf5")  # beside them, STAG's folders hold gigabytes of video frames


def root() -> Path:
    """Root of the repository that `dvc` was called in, also inside the temporary workspaces of its experiments."""
    return Path(os.environ.get("DVC_ROOT") or Path.cwd()).resolve()


@contextmanager
def whole(path: str | Path) -> Iterator[Path]:
    """A path to write to, renamed to `path` when the block ends well and removed when it does not.

    The name beside it is the same on every call: torch.save writes it into the file, and two runs with one
    seed are to give equal bytes.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: str | Path) -> Iterator[Path]:
    """The same for a folder: an empty one to write to, which takes the place of `path` when the block ends well."""
    path = Path(path)
    if path.exists() and (path.is_symlink() or not path.is_dir()):
        raise FileExistsError(f"{path}: there, and no folder; remove it, or name another")
    part, old = path.with_name(path.name + ".part"), path.with_name(path.name + ".old")
    for stale in (part, old):
        shutil.rmtree(stale, ignore_errors=True)
    part.mkdir(parents=True)
    try:
        yield part
        if path.exists():
            path.replace(old)
        part.replace(path)
    finally:
        for stale in (part, old):
            shutil.rmtree(stale, ignore_errors=True)


@contextmanager
def readable(path: str | Path) -> Iterator[None]:
    """For reading what an earlier stage wrote.

    Raises:
        ValueError: the file is damaged, or of another version of the project.
    """
    try:
        yield
    except (OSError, KeyError, TypeError, RuntimeError, EOFError, UnpicklingError) as error:
        reason = f"{type(error).__name__}: {str(error).partition('. ')[0]}"
        raise ValueError(
            f"{path}: damaged, or not written by this version ({reason}); delete it and run `dvc repro` again"
        ) from error


def md5(path: str | Path) -> str:
    """The md5 of a file, or of a folder's recordings: their paths and md5s in sorted order."""
    path = Path(path)
    digest = hashlib.md5(usedforsecurity=False)
    if path.is_dir():
        for file in sorted(p for p in path.rglob("*") if p.suffix in RECORDINGS):
            digest.update(f"{file.relative_to(path).as_posix()} {md5(file)}\n".encode())
        return digest.hexdigest()
    with path.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
