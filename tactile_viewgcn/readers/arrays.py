"""Reading folders of arrays, one file a recording: OBJECT/FILE, or with folders of sessions or sides.

An array is (frames, rows, columns), or (frames, cells) with the cells row after row. With a layout (rows and
columns of a frame) it may also be one frame; without a layout, (frames, cells) are frames of one row.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import numpy as np

from tactile_viewgcn.files import TEXTS, arrays_below
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.columns import Columns, columns_of, named, sensors_and_time
from tactile_viewgcn.readers.folder import Names, joined
from tactile_viewgcn.readers.labelled_table import read_labelled
from tactile_viewgcn.readers.source import TEST, TRAIN, UNLABELLED, Source, Values, frames_shape, listed
from tactile_viewgcn.readers.text import Table, read_table

PLACES = "OBJECT/FILE, SESSION/OBJECT/FILE or OBJECT/SESSION/FILE"
#: Sides of the published split by the names of their folders; `preprocess` draws its own validation side.
SIDES = {"train": TRAIN, "training": TRAIN, "val": TRAIN, "validation": TRAIN, "test": TEST, "testing": TEST}
#: A folder of a session is named by a number, a day, or one of these words with or without a number.
SESSION = re.compile(
    r"[\W\d_]+(t[\W\d_]+z?)?|(mon|tues?|wed(nes)?|thu(rs)?|fri|sat(ur)?|sun)(day)?|[spdrt][\W_]*\d+"
    r"|(session|sess|ses|day|date|week|visit|run|rec|recording|trial|take|subject|subj|sub|participant|person|user)"
    r"([\W\d_].*)?",
    re.IGNORECASE,
)


def read_arrays(path: Path, layout: Sequence[int] | None = None, *, labelled: bool = True) -> Source:
    """All files of arrays below a folder, whose folders are read as `_roles` says; without sessions there is one.

    Args:
        layout: rows and columns of a frame; None: as the arrays have them.
        labelled: False: files may lie in no object's folder, or be one file; their object is `UNLABELLED`.

    Raises:
        UserError: lists the mistakes of all files, and where they differ in shape or depth, or share a name.
    """
    root, files = (path if path.is_dir() else path.parent), arrays_below(path)
    columns = next(map(columns_of, _tables(files)), None)
    if columns and path.is_file() and {"object", *["recording"] * (not labelled)} & named(columns.names).keys():
        return read_labelled(path, columns, tuple(layout or ()))
    places = [file.relative_to(root).parts[:-1] for file in files]
    depth = Counter(map(len, places)).most_common(1)[0][0]
    alike = [place for place in places if len(place) == depth]
    roles = _roles(alike)
    size = tuple(layout or ())
    opened = partial(_opened, root=root, depth=depth, roles=roles, layout=size, labelled=labelled, columns=columns)
    source = joined(path, files, opened)
    if columns:
        source.notes.extend(columns.notes)
        source.channels.extend(columns.channels)
    if roles:
        order = ", ".join(f"{folder} is the {role}" for role, folder in zip(roles, alike[0], strict=True))
        text = f"folders are in the order {'/'.join(roles).upper()}/FILE: {order}"
        source.notes.append(Note(text, topic="folders"))
    return source


def _roles(places: list[tuple[str, ...]]) -> tuple[str, ...]:
    """What the folders above each file name, from the outermost: `object`, `session` or `split`.

    Folders that are all named as a side are the split. Of two others the inner ones are the objects, unless the outer
    ones are more likely to be: there is a folder of the empty hand, their names are not those of sessions, or only they
    have several names.

    Args:
        places: names of the folders above each file, equally many.
    """
    levels = [set(level) for level in zip(*places, strict=True)]
    sides = [{name.lower() for name in level} <= SIDES.keys() for level in levels]
    likely = [
        (EMPTY_HAND in level, not all(map(SESSION.fullmatch, level)), len(level) > 1)
        for level, is_side in zip(levels, sides, strict=True)
        if not is_side
    ]
    if len(likely) > 2:
        return ()
    others = iter(["object", "session"] if len(likely) == 1 or likely[:1] > likely[1:] else ["session", "object"])
    return tuple("split" if is_side else next(others) for is_side in sides)


def _is_table(file: Path) -> bool:
    return file.name.lower().endswith(TEXTS)


def _tables(files: list[Path]) -> Iterator[Table]:
    """The tables in files, but for those that cannot be read, whose mistakes `joined` lists."""
    for file in filter(_is_table, files):
        with suppress(UserError), reading(file):
            yield read_table(file)


@contextmanager
def _opened(
    file: Path,
    root: Path,
    depth: int,
    roles: tuple[str, ...],
    layout: tuple[int, ...],
    labelled: bool,
    columns: Columns | None,
) -> Iterator[tuple[Names, Values]]:
    *folders, _ = (place := file.relative_to(root)).parts
    if len(folders) != depth:
        raise UserError(f"{file}: in {len(folders)} folders; expected {depth} as for most files, which are {PLACES}")
    if len(folders) > len(roles) or (labelled and "object" not in roles):
        raise UserError(
            f"{root}: {str(place)!r} names no object; expected {PLACES}, or one table with a column `object`"
        )
    names = dict(zip(roles, folders, strict=True))
    values = sensors_and_time(read_table(file), columns) if _is_table(file) else {"pressure": _read(file)}
    values["pressure"] = values["pressure"].reshape(frames_shape(values["pressure"].shape, layout, file))
    if side := names.pop("split", ""):
        values["split"] = np.full(len(values["pressure"]), SIDES[side.lower()])
    recording = {"recording": place.as_posix().removesuffix(".gz").rpartition(".")[0]}
    yield {"object": UNLABELLED, "session": "session"} | names | recording, values


def _read(file: Path) -> np.ndarray:
    """The array in a file; .npy is memory-mapped. Nothing is unpickled."""
    if file.suffix.lower() == ".npz":
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
            names = [name for name in arrays if len(arrays) == 1 or name == "pressure"]
            if not names:
                raise ValueError(f"arrays: {listed(list(arrays)) or 'none'}; expected one, or pressure among them")
            return arrays[names[0]]
    array = np.load(file, mmap_mode="r", allow_pickle=False)
    if array.offset + array.nbytes != file.stat().st_size:
        raise ValueError("there are more bytes after the array")
    return array
