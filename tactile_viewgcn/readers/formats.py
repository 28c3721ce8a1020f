"""Finding out in which form a path holds recordings, and opening them: STAG's, one table of all, or one file each.

An array is (frames, rows, columns), or (frames, cells) with the cells row after row. With a shape (rows and
columns of a frame) it may also be one frame; without one, (frames, cells) are frames of one row.
"""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path, PureWindowsPath
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.files import all_below
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, listed, once_each, several
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.hdf5 import (
    is_raw,
    matlab_fields,
    open_hdf5,
    read_metadata,
    read_raw,
    read_recording,
)
from tactile_viewgcn.readers.join import joined
from tactile_viewgcn.readers.source import AUTO, Form, Recording, Source, no_array, setting, side_of, tidy
from tactile_viewgcn.readers.text import CONTENTS, read_table, recordings_in

TEXTS = (".csv", ".tsv", ".csv.gz", ".txt")  # endings of tables as text
PLACES = "OBJECT/FILE or SESSION/OBJECT/FILE"
HDF5, ARRAYS = (".h5", ".hdf5"), (".npy", ".npz", ".mat")
EXPECTED = (
    f"expected a STAG metadata.mat, a STAG folder, a folder of {PLACES} with .npy, .npz, .mat, .csv, .txt or .h5, or a "
    ".csv with a column `object` (see the manual's page on data)"
)


def files_of(path: Path) -> list[Path]:
    """A file itself, or all files below a folder, see `all_below`."""
    return all_below(path) if path.is_dir() else [path]


def among(files: Sequence[Path], *endings: str) -> list[Path]:
    """The files with one of these endings."""
    return [file for file in files if file.name.lower().endswith(endings)]


def open_source(path: str | Path, form: Form = AUTO, files: Sequence[Path] | None = None) -> Source:
    """The source at a path: STAG's metadata.mat or folder, or recordings in HDF5, arrays and tables.

    A damaged file may crash this process; `read_source` uses a separate one.

    Args:
        form: of recordings that are not STAG's.
        files: see `files_of`; found here if not given.

    Raises:
        FileNotFoundError: nothing is at that path.
        UserError: a file is of none of these forms, or damaged.
    """
    path, is_hdf5 = Path(path), False
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder; {EXPECTED}")
    files = files_of(path) if files is None else files
    if raw := [file for file in files if is_raw(file, path)]:
        return joined(path, raw, lambda file: [read_raw(file)])
    if not path.is_dir():
        with reading(path):
            is_hdf5, is_stag = h5py.is_hdf5(path), path.name == "metadata.mat"
            if is_stag or ((is_hdf5 or path.suffix.lower() == ".mat") and matlab_fields(path, ("objectId",))):
                return read_metadata(path)
    recordings = [path] if is_hdf5 else among(files, *HDF5, *ARRAYS, *TEXTS)
    if not recordings:
        raise UserError(f"{path}: no recordings in it, found {endings_of(files) or 'nothing'}; {EXPECTED}")
    return read_files(path, recordings, form, [file for file in files if file not in set(recordings)])


def read_files(path: Path, files: list[Path], form: Form, unread: list[Path]) -> Source:
    """Files below a folder, or a single one: a recording each, or one table whose columns name recordings.

    Folders name objects and sessions, see `layout_of`, but for those of HDF5 files with an attribute `object`. Files of
    text that hold no table are left out; a note counts them and those `unread` for their endings.

    Raises:
        UserError: as `joined`.
    """
    table, left = cache(partial(read_table, form=form)), dict[Path, str]()
    for file in among(files, ".txt") if len(files) > 1 else ():
        try:
            with reading(file):
                table(file)
        except UserError as error:
            left[file] = str(error)
    files = [file for file in files if file not in left]
    if not files:
        raise UserError(listed(once_each(left.items()), "; "))

    root = path if path.is_dir() else path.parent
    tables, named = labels_in(files)
    files = [file for file in files if file not in tables]
    layout, guessed = layout_of(root, files, form)

    def object_of(file: Path) -> str | None:
        """The object in a file's path; None of a file that lies elsewhere."""
        if named:
            return named.get(file.stem, {}).get("object")
        match = matched(file, root, layout)
        return match.groupdict().get("object", None if form.labelled else "") if match else None

    def parts_of(file: Path) -> list[Recording]:
        """The recordings in a file, with the names that stand in it."""
        if among([file], *TEXTS):
            recording, labels = table(file)
            parts = recordings_in(recording, labels) if len(files) == 1 else [recording]
            return parts if "object" in labels or not form.labelled else [recording]
        if among([file], *ARRAYS):
            arrays = arrays_in(file)
            return windows_in(file, arrays, form) or [Recording({}, _chosen(file, arrays, form))]
        opened = open_hdf5(file)
        return windows_in(file, opened, form) or [read_recording(opened, form)]

    def opened(file: Path) -> list[Recording]:
        """The recordings in a file, with the names in its path where it holds one alone that names no object."""
        recordings, parts = list[Recording](), parts_of(file)
        for part in parts:
            names, notes, values = named.get(file.stem, {}) | part.names, part.notes, part.values
            names = {"recording": place_of(file, path)} | names
            if len(parts) == 1 and not names.get("object") and (form.labelled or among([file], *TEXTS, *ARRAYS)):
                names, notes = names_of(file, root, layout, form) | names, [*notes, *guessed]
            if side := names.pop("split", ""):
                if (code := side_of(side)) is None:
                    raise UserError(f"{file}: split is {side!r}; expected train, test or validation")
                values = values | {"split": np.full(len(values["pressure"]), code)}
            recordings.append(replace(part, names=names, values=values, notes=notes))
        return recordings

    source = joined(path, files, opened, form)
    source.notes.extend(unread_note(path, files, dict.fromkeys(unread, "") | left, object_of))
    return source


def labels_in(files: Sequence[Path]) -> tuple[list[Path], dict[str, dict[str, str]]]:
    """The tables among files that name files and their objects, as labels.csv; and the names by a file's own name.

    Raises:
        UserError: two lines name one file unlike.
    """
    tables, names = list[Path](), dict[str, dict[str, str]]()
    for file in among(files, ".csv", ".tsv"):
        with reading(file), file.open(encoding="utf-8-sig", errors="replace") as stream:
            header = [name.strip(' "\n') for name in re.split("[,;\t]", stream.readline())]
        kinds = {name: kind for name in header if (kind := CONTENTS.get(name.lower(), "")) in ("object", "session")}
        column = next((name for name in header if re.fullmatch(r"file[ _]?(name|path)?s?|path", name.lower())), None)
        if column is None or "object" not in kinds.values():
            continue
        import pandas as pd  # here, since it loads slowly

        with reading(file):
            table = pd.read_csv(file, sep=None, engine="python", dtype=str, keep_default_na=False).rename(columns=kinds)
        tables.append(file)
        for place, row in zip(table[column], table[[*kinds.values()]].to_dict("records"), strict=True):
            stem, row = PureWindowsPath(place).stem, {str(kind): tidy(name) for kind, name in row.items()}
            if names.setdefault(stem, row) != row:
                raise UserError(f"{file}: {stem} has two labels; expected a name of its own for each file")
    return tables, names


def windows_in(file: Path, arrays: Mapping[str, Any], form: Form) -> list[Recording]:
    """The windows X (n, T, C) or (n, T, H, W) among arrays with labels y (n,), a recording each; none without labels.

    A window that begins inside the one before is of the same take.
    """
    default = next((name for name in arrays if name.lower() in ("y", "label", "labels")), "")
    name = form.columns.get("object", default)
    if "pressure" in arrays or name not in arrays:
        return []
    labels = [one.decode() if isinstance(one, bytes) else one for one in np.ravel(arrays[name]).tolist()]
    large = [key for key in arrays if getattr(arrays.get(key), "ndim", 0) > 2 and len(arrays[key]) == len(labels) > 0]
    if len(large) != 1 or [*arrays[large[0]].shape[1:]] == [*form.shape]:
        return []
    X = arrays[large[0]][()]
    begins = (X[:-1] == X[1:, :1]).all(axis=tuple(range(2, X.ndim))).any(axis=1)
    takes = np.cumsum([0, *~begins])
    note = Note(f"{large[0]} holds {len(X):,} windows of {X.shape[1]} frames, labelled by {name}", topic="windows")
    recordings = list[Recording]()
    for at, (window, label, take) in enumerate(zip(X, labels, takes.tolist(), strict=True)):
        names = {"recording": f"{file.stem}/{at}", "object": f"{label:.0f}" if isinstance(label, float) else f"{label}"}
        recordings.append(Recording(names | {"take": f"{file}/{take}"}, {"pressure": window}, notes=[note]))
    return recordings


def unread_note(
    path: Path, files: Sequence[Path], unread: Mapping[Path, str], object_of: Callable[[Path], str | None]
) -> list[Note]:
    """A note on the number of files below a folder that are not read; a warning where an object lacks recordings so.

    A file that is called as one that is read, but for its ending, is no recording more.

    Args:
        files: that are read.
        unread: what is wrong in each of the others, "" where its ending says it.
    """
    if not unread:
        return []
    known, read = {place_of(file, path) for file in files}, Counter(map(object_of, files))
    lost = Counter(object_of(file) for file in unread if place_of(file, path) not in known)
    lost.pop(None, None)
    text = f"{several(len(unread), 'file')} not read ({endings_of(list(unread))})"
    if reasons := [*filter(None, unread.values())]:
        text += f": {listed(reasons, '; ')}"
    if not lost:
        return [Note(f"{text}.", topic="files")]
    parts = [f"{name} {read[name]} of {read[name] + count}".strip() for name, count in sorted(lost.items())]
    text += f". Read of the files that lie there: {listed(parts)}. Save the others as .npy or .csv, or move them away."
    return [Note(text, "warning", "files")]


def arrays_in(file: Path) -> dict[str, Any]:
    """The arrays in a .npy, .npz or .mat by their names; .npy is memory-mapped. Nothing is unpickled."""
    if among([file], ".mat"):
        return matlab_fields(file)
    if among([file], ".npz"):
        with np.load(file, allow_pickle=False) as stored:
            return dict(stored)
    array = np.load(file, mmap_mode="r", allow_pickle=False)
    if array.offset + array.nbytes != file.stat().st_size:
        raise ValueError("there are more bytes after the array")
    return {"pressure": array}


def _chosen(file: Path, arrays: dict[str, Any], form: Form) -> dict[str, Any]:
    """`pressure`, or the only array, and `time` if the form names it."""
    if other := form.columns.keys() - {"pressure", "time"}:
        raise UserError(f"{file}: data.columns names {listed(sorted(other))}; an array has `pressure` and `time` alone")
    if among([file], ".npy"):
        return arrays
    names = {"pressure": "pressure"} | dict(form.columns)
    large = [name for name, array in arrays.items() if sum(size > 1 for size in array.shape) > 1]
    if "pressure" not in form.columns and len(large) == 1:
        names["pressure"] = large[0]
    if missing := [name for name in names.values() if name not in arrays]:
        raise no_array(missing[0], list(arrays), str(file))
    values = {kind: np.asarray(arrays[name]) for kind, name in names.items()}
    return {kind: array.ravel() if kind == "time" else array for kind, array in values.items()}


def endings_of(files: Sequence[Path]) -> str:
    """Number of files of each ending, such as `12 .json, 1 .md`."""
    counts = Counter(file.suffix.lower() or file.name for file in files)
    return listed([f"{count:,} {ending}" for ending, count in counts.most_common()])


def names_of(file: Path, root: Path, layout: str, form: Form) -> dict[str, str]:
    """The names in the path of a file below a folder, by `object`, `session` and `split`.

    Raises:
        UserError: the path is not of that layout, or names no object where files are labelled.
    """
    if not (match := matched(file, root, layout)):
        remedy = (
            "" if form.layout == "auto" else f"; params.yaml may have it from others: {setting('data.layout=auto')}"
        )
        raise UserError(f"{file}: expected {layout} (data.layout), or an attribute `object` in HDF5{remedy}")
    if form.labelled and "object" not in match.groupdict():
        raise UserError(
            f"{file}: names no object; expected {PLACES}, a table with a column "
            "`object`, or an attribute `object` in HDF5; "
            f"{setting('data.layout=OBJECT_FILE')} for names such as mug_1.csv"
        )
    return match.groupdict()


def matched(file: Path, root: Path, layout: str) -> re.Match[str] | None:
    """The parts of a file's path below a folder by the words of a layout; None: it is not of that layout."""
    pattern = re.sub("SESSION|SPLIT", lambda part: f"(?P<{part[0].lower()}>[^/]+?)", re.escape(layout))
    pattern = pattern.replace("OBJECT", "(?P<object>[^/]+)").replace("FILE", "[^/]+")  # tea_box is one name
    return re.fullmatch(pattern, place_of(file, root))


def place_of(file: Path, path: Path) -> str:
    """The path of a file below a folder, without its ending: the name of its recording; of a file alone its name."""
    place = file.name if file == path else file.relative_to(path).as_posix()
    return re.sub(r"(?i)(\.csv)?\.\w+$", "", place)


def layout_of(root: Path, files: Sequence[Path], form: Form) -> tuple[str, list[Note]]:
    """The layout of files below a folder, such as SESSION/OBJECT/FILE, and a note on it if it is a guess.

    It is the given one, or by `auto` that of most files. Folders that are all called as sides are the published split.
    Of the others the innermost is the object and the one above it the session: a file train/monday/mug/1.npy is
    SPLIT/SESSION/OBJECT/FILE. No layout fits files that lie deeper.
    """
    if form.layout != "auto":
        return form.layout, []
    places = [file.relative_to(root).parts[:-1] for file in files]
    depth = Counter(map(len, places)).most_common(1)[0][0]
    levels = list(zip(*(place for place in places if len(place) == depth), strict=True))
    are_sides = [None not in map(side_of, level) for level in levels]
    count = are_sides.count(False)
    if count > 2 or not levels:
        return "SESSION/OBJECT/FILE" if levels else "FILE", []
    roles = iter(["SESSION", "OBJECT"][2 - count :])
    order = ["SPLIT" if is_side else next(roles) for is_side in are_sides]
    text = "/".join([*order, "FILE"])
    note = f"folders are in the order {text}: "
    note += ", ".join(f"{level[0]} is the {role.lower()}" for level, role in zip(levels, order, strict=True))
    if count < 2 or EMPTY_HAND in levels[order.index("OBJECT")]:
        return text, [Note(note, topic="folders")]
    note += f". If not, {setting(f'data.layout={other_order(text)}')}; else data.layout={text}"
    return text, [Note(note, "warning", "folders", "data.layout", text)]


def other_order(layout: str) -> str:
    """The layout with sessions and objects in each other's place."""
    return "/".join({"SESSION": "OBJECT", "OBJECT": "SESSION"}.get(role, role) for role in layout.split("/"))
