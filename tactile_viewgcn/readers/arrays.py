"""Reading folders of arrays, one file a recording: OBJECT/NAME.npy, .npz or .csv, or with folders of sessions or sides.

An array is (frames, rows, columns), or (frames, cells) with the cells row after row. With a layout (rows and
columns of a frame) it may also be one frame; without a layout, (frames, cells) are frames of one row.
"""

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from tactile_viewgcn.files import ARRAYS, files_below
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError
from tactile_viewgcn.readers.folder import Names, joined
from tactile_viewgcn.readers.source import MAX_SIDE, TEST, TRAIN, UNLABELLED, Source, Values, listed

HEADER = r"\s*(?:[#%]|(?!(?:nan|inf(?:inity)?)\b)[\"']?\s*[^\W\d])"  # a line of names in a .csv begins so
TIME = r"[\s#%\"']*time(?:stamp)?(?![a-z])"  # a line of names begins so where the first column holds times
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
    root, files = (path if path.is_dir() else path.parent), files_below(path, ARRAYS)
    places = [file.relative_to(root).parts[:-1] for file in files]
    depth = Counter(map(len, places)).most_common(1)[0][0]
    alike = [place for place in places if len(place) == depth]
    roles = _roles(alike)
    opened = partial(_opened, root=root, depth=depth, roles=roles, layout=tuple(layout or ()), labelled=labelled)
    source = joined(path, files, opened)
    if roles:
        named = ", ".join(f"{folder} is the {role}" for role, folder in zip(roles, alike[0], strict=True))
        text = f"folders are in the order {'/'.join(roles).upper()}/FILE: {named}"
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


@contextmanager
def _opened(
    file: Path, root: Path, depth: int, roles: tuple[str, ...], layout: tuple[int, ...], labelled: bool
) -> Iterator[tuple[Names, Values]]:
    *folders, _ = (place := file.relative_to(root)).parts
    if len(folders) != depth:
        raise UserError(f"{file}: in {len(folders)} folders; expected {depth} as for most files, which are {PLACES}")
    if len(folders) > len(roles) or (labelled and "object" not in roles):
        raise UserError(f"{root}: {str(place)!r} names no object; expected {PLACES}")
    names = dict(zip(roles, folders, strict=True))
    array = _read(file)
    values = {"pressure": array.reshape(_shape(array.shape, layout, file))}
    if side := names.pop("split", ""):
        values["split"] = np.full(len(values["pressure"]), SIDES[side.lower()])
    recording = {"recording": place.with_suffix("").as_posix()}
    yield {"object": UNLABELLED, "session": "session"} | names | recording, values


def _shape(shape: tuple[int, ...], layout: tuple[int, ...], file: Path) -> tuple[int, ...]:
    """The shape (T, H, W) of the recording in an array of shape `shape`."""
    if layout and shape == layout:
        return 1, *layout
    if layout and shape in ((*shape[:1], math.prod(layout)), (*shape[:1], *layout)):
        return shape[0], *layout
    if layout:
        expected = f"(frames, {layout[0]}, {layout[1]}) or (frames, {math.prod(layout)})"
        raise UserError(f"{file}: an array {shape}; expected {expected} by --shape, data.shape or the model")
    if len(shape) == 2 and shape[1] > MAX_SIDE:
        raise UserError(f"{file}: an array {shape}; expected a layout by data.shape (inspect --shape ROWS COLUMNS)")
    return (shape[0], 1, shape[1]) if len(shape) == 2 else shape


def _read(file: Path) -> np.ndarray:
    """The array in a file; .npy is memory-mapped. Nothing is unpickled."""
    if file.suffix.lower() == ".csv":
        return _csv(file)
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


def _csv(file: Path) -> np.ndarray:
    """Numbers (lines, cells), integers where all are, without a first line of names and a first column of times."""
    lines = re.findall(r"\S.*", file.read_text(encoding="utf-8-sig"))  # without blank lines
    words, times = (bool(re.match(pattern, "".join(lines[:1]), re.IGNORECASE)) for pattern in (HEADER, TIME))
    if len(lines) <= words:
        raise ValueError("no line of numbers")
    mark = next((mark for mark in ",;" if mark in lines[words]), None)
    columns = range(1, len(lines[words].split(mark))) if times else None
    read = partial(np.loadtxt, lines[words:], delimiter=mark, comments=None, ndmin=2, usecols=columns)
    try:
        return read(dtype=np.int64)
    except ValueError:
        pass
    try:
        return read(dtype=np.float64)
    except ValueError as error:  # quotes the text, but a link may lead to a file that the user does not mean to show
        raise ValueError(re.sub(r" (['\"]).*\1", "", str(error))) from None
