"""Find the files of recordings at a path, in order, and the files that are not read."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from tactile_viewgcn.files import all_below, home_path
from tactile_viewgcn.messages import Note, UserError, listed, several
from tactile_viewgcn.readers.catalogue import given_rows, names_in_text
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.formats import ARRAYS, HDF5, STAG_RAW, TEXTS, has_ending
from tactile_viewgcn.readers.hdf5 import is_hdf5
from tactile_viewgcn.readers.layout import PLACES, place_of
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.readers.text import read_text

EXPECTED = (
    f"expected a STAG metadata.mat or folder, a folder of {PLACES} with .npy, .npz, .mat, .csv, "
    ".tsv, .csv.gz, .txt or .h5, a .csv with a column `object`, or a catalogue "
    "(see the manual's page on data)"
)
RAW_DEPTH = 3  # parts of the path [batch]/[recording]/pressuredata.mat


@dataclass(frozen=True)
class Source:
    """The files at a path.

    Attributes:
        path: the path of the source, which errors name.
        root: the folder that the places of the files begin at.
        files: the files of recordings, and tables that can name their objects, in order.
        unread: the files that are not read because of their endings.
        is_raw: whether the files are STAG's raw recordings.
        given: the rows of a catalogue that is the source, see `given_rows`; else None.
        left_out: the number of lines of the catalogue that are left out.
        texts: the text of a file that was read in search of a catalogue, and is none.
    """

    path: Path
    root: Path
    files: list[Path]
    unread: list[Path] = field(default_factory=list)
    is_raw: bool = False
    given: pd.DataFrame | None = None
    left_out: int = 0
    texts: dict[Path, str] = field(default_factory=dict)

    def place_of(self, file: Path) -> str:
        """Return the path of a file from the root, without its ending."""
        return place_of(file, self.root)


def files_of(path: Path) -> list[Path]:
    """Return a file itself, or all files below a folder, see `all_below`."""
    return all_below(path) if path.is_dir() else [path]


def bytes_of(files: Sequence[Path]) -> int:
    """Return the bytes of all files that exist."""
    return sum(file.stat().st_size for file in files if file.is_file())


def discover(path: str | Path, form: Form) -> Source:
    """Return the source at a path.

    If the path is a single table, it is read to see whether it is a catalogue. No other file is
    read.

    Args:
        path: STAG's metadata.mat or folder, recordings in HDF5, arrays or tables, or a catalogue.
        form: the form in which recordings are read.

    Raises:
        FileNotFoundError: nothing is at that path.
        UserError: no recordings are there, or a catalogue has mistakes.
    """
    path = Path(path)
    if not path.exists() and not path.is_symlink():
        home = home_path(path)
        what = EXPECTED if home == str(path) else f"~ is not expanded here; write {home}"
        raise FileNotFoundError(f"{path}: no such file or folder; {what}")
    if not path.is_dir():
        return _single(path, form)
    files = files_of(path)
    raw = [file for file in files if _is_raw(file, path)]
    if raw:
        return Source(path, path, raw, is_raw=True)
    recordings = [file for file in files if has_ending(file, [*HDF5, *ARRAYS, *TEXTS])]
    unread = [file for file in files if file not in set(recordings)]
    if not recordings:
        raise _no_recordings(path, files)
    return Source(path, path, recordings, unread)


def _is_raw(file: Path, path: Path) -> bool:
    return file.name == STAG_RAW and len(file.relative_to(path).parts) == RAW_DEPTH


def _single(path: Path, form: Form) -> Source:
    """Return the source of a single file: a recording, a table of recordings, or a catalogue."""
    root = path.parent
    with reading(path):
        if has_ending(path, [".csv", ".tsv"]):
            text = read_text(path)
            names = names_in_text(path, text)
            if names is None:
                return Source(path, root, [path], texts={path: text})
            given = given_rows(path, names, form)
            files = sorted(set(given["path"]))
            return Source(path, root, files, given=given, left_out=len(names) - len(given))
        if not has_ending(path, [*HDF5, *ARRAYS, *TEXTS]) and not is_hdf5(path):
            raise _no_recordings(path, [path])
    return Source(path, root, [path])


def _no_recordings(path: Path, files: list[Path]) -> UserError:
    found = endings_of(files) or "nothing"
    if any(has_ending(file, [".dvc"]) for file in files):
        found += "; if DVC keeps them: dvc pull"
    return UserError(f"{path}: no recordings in it, found {found}; {EXPECTED}")


def endings_of(files: Sequence[Path]) -> str:
    """Return the number of files of each ending, such as `12 .json, 1 .md`."""
    counts = Counter(file.suffix.lower() or file.name for file in files)
    return listed([f"{count:,} {ending}" for ending, count in counts.most_common()])


def unread_notes(
    path: Path,
    files: Sequence[Path],
    unread: Mapping[Path, str],
    object_of: Callable[[Path], str | None],
) -> list[Note]:
    """Return a note on the number of files below a folder that are not read.

    The note is a warning if an object lacks recordings for this reason. A file whose name differs
    from one of `files` only in its ending does not count as another recording.

    Args:
        path: the path of the source.
        files: the files that are read.
        unread: the mistake in each of the other files, "" if only its ending is the reason.
        object_of: gives the object of a file, None if it has none.
    """
    if not unread:
        return []
    known = {place_of(file, path) for file in files}
    read = Counter(map(object_of, files))
    lost = Counter(object_of(file) for file in unread if place_of(file, path) not in known)
    lost.pop(None, None)
    reasons = [endings_of(list(unread)), *filter(None, unread.values())]
    text = f"{several(len(unread), 'file')} not read ({listed(reasons, '; ')})"
    if not lost:
        return [Note(f"{text}.", topic="files")]
    parts = list[str]()
    for name, count in sorted(lost.items()):
        parts.append(f"{name} {read[name]} of {read[name] + count}".strip())
    text += f". Files read, out of all files there: {listed(parts)}. "
    text += "Save the others as .npy or .csv, or move them away."
    return [Note(text, "warning", "files")]
