"""Finding out in which form a path holds recordings, and opening them: STAG's, one table of all, or one file each.

An array is (frames, rows, columns), or (frames, cells) with the cells row after row. With a shape (rows and
columns of a frame) it may also be one frame; without one, (frames, cells) are frames of one row.
"""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.files import all_below
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, several
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.hdf5 import read_recording
from tactile_viewgcn.readers.source import (
    AUTO,
    SPLITS,
    Form,
    Recording,
    Source,
    framed,
    joined,
    listed,
    no_array,
    setting,
    side_of,
)
from tactile_viewgcn.readers.stag import is_raw, matlab_fields, read_folder, read_metadata
from tactile_viewgcn.readers.text import Table, read_table

TEXTS = (".csv", ".tsv", ".csv.gz", ".txt")  # endings of tables as text
HDF5, ARRAYS = (".h5", ".hdf5"), (".npy", ".npz", ".mat")
PLACES = "OBJECT/FILE or SESSION/OBJECT/FILE"
EXPECTED = (
    f"expected a STAG metadata.mat, a STAG folder, a folder of {PLACES} with .npy, .npz, .mat, .csv, .txt or .h5, or a "
    ".csv with a column `object` (see the manual's page on data)"
)


def files_of(path: Path) -> list[Path]:
    """A file itself, or all files below a folder, see `all_below`."""
    return all_below(path) if path.is_dir() else [path]


def recordings_among(files: Sequence[Path], *endings: str) -> list[Path]:
    """Files whose ending is that of recordings, or one of the given."""
    return [file for file in files if file.name.lower().endswith(endings or (*HDF5, *ARRAYS, *TEXTS))]


def are_arrays(path: Path) -> bool:
    """Whether a path holds arrays or tables, whose shape the user may have to set."""
    return bool(recordings_among(files_of(path), *ARRAYS, *TEXTS))


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
        return read_folder(path, raw)
    if not path.is_dir():
        with reading(path):
            is_hdf5, is_stag = h5py.is_hdf5(path), path.name == "metadata.mat"
            if is_stag or ((is_hdf5 or path.suffix.lower() == ".mat") and matlab_fields(path, ("objectId",))):
                return read_metadata(path)
    recordings = [path] if is_hdf5 else recordings_among(files)
    if not recordings:
        others = listed(sorted({file.suffix or file.name for file in files})) or "nothing"
        raise UserError(f"{path}: no recordings in it, found {others}; {EXPECTED}")
    return read_files(path, recordings, form)


def read_files(path: Path, files: list[Path], form: Form) -> Source:
    """Files below a folder, or a single one: a recording each, or one table whose columns name recordings.

    Folders name objects and sessions, see `layout_of`, but for those of HDF5 files with an attribute `object`. Files of
    text that hold no table are left out, with a note.

    Raises:
        UserError: as `joined`.
    """
    table, left = cache(partial(read_table, form=form)), list[str]()
    for file in recordings_among(files, ".txt") if len(files) > 1 else ():
        try:
            with reading(file):
                table(file)
        except UserError as error:
            left.append(str(error))
            files = [each for each in files if each != file]
    if not files:
        raise UserError(listed(left, "; "))
    layout = cache(partial(layout_of, path, files, form))
    if len(files) == 1 and recordings_among(files, *TEXTS):
        with reading(files[0]):
            if (alone := table(files[0])).has_recordings(labelled=form.labelled):
                named = enumerate(alone.recordings(form), 1)
                parts = {Path(f"{files[0]}, recording {number}"): part for number, part in named}
                return joined(path, list(parts), parts.__getitem__)
    if not recordings_among(files, *HDF5):  # which may name objects themselves
        layout()
    source = joined(path, files, partial(_opened, path=path, layout=layout, table=table, form=form))
    if layout.cache_info().currsize:
        source.notes.extend(layout().notes)
    if left:
        source.notes.append(Note(f"{several(len(left), 'file')} without a table: {listed(left, '; ')}", topic="files"))
    return source


def _opened(
    file: Path, path: Path, layout: Callable[[], "Layout"], table: Callable[[Path], Table], form: Form
) -> Recording:
    """The recording in a file, with the names in its path."""
    if is_text := file.name.lower().endswith(TEXTS):
        read = table(file)
        recording = Recording({}, read.values(form), read.channel_names, read.notes)
    elif is_array := file.suffix.lower() in ARRAYS:
        recording = Recording({}, _arrays(file, form))
    else:
        recording = read_recording(file, form)
    names, values = recording.names, recording.values
    values["pressure"] = framed(values["pressure"], form, str(file))
    if is_text or is_array or (form.labelled and not names.get("object")):
        names = layout().names(file, labelled=form.labelled) | names
    names = {"recording": place_of(file, path)} | names
    if side := names.pop("split", ""):
        values["split"] = np.full(len(values["pressure"]), side_of(side, str(file)))
    return Recording(names, values, recording.channel_names, recording.notes, recording.dropped)


def _arrays(file: Path, form: Form) -> dict[str, Any]:
    """`pressure`, or the only array, and `time` if the form names it; .npy is memory-mapped. Nothing is unpickled."""
    if other := form.columns.keys() - {"pressure", "time"}:
        raise UserError(f"{file}: data.columns names {listed(sorted(other))}; an array has `pressure` and `time` alone")
    if file.suffix.lower() == ".npy":
        array = np.load(file, mmap_mode="r", allow_pickle=False)
        if array.offset + array.nbytes != file.stat().st_size:
            raise ValueError("there are more bytes after the array")
        return {"pressure": array}
    if file.suffix.lower() == ".npz":
        with np.load(file, allow_pickle=False) as stored:
            return _named(file, stored, list(stored), form)
    arrays = matlab_fields(file)
    large = [name for name, array in arrays.items() if sum(size > 1 for size in array.shape) > 1]
    return _named(file, arrays, large, form)


def _named(file: Path, arrays: Any, large: list[str], form: Form) -> dict[str, Any]:
    """The arrays of the form's names; without a name for the pressure `pressure`, or the only one that is `large`."""
    names = {"pressure": "pressure"} | dict(form.columns)
    if "pressure" not in form.columns and len(large) == 1:
        names["pressure"] = large[0]
    if missing := [name for name in names.values() if name not in arrays]:
        raise no_array(missing[0], large, str(file))
    values = {kind: np.asarray(arrays[name]) for kind, name in names.items()}
    return {kind: array.ravel() if kind == "time" else array for kind, array in values.items()}


@dataclass(frozen=True)
class Layout:
    """A pattern such as SESSION/OBJECT/FILE or OBJECT_FILE of the paths of files below a folder."""

    root: Path
    text: str
    notes: tuple[Note, ...] = ()

    def names(self, file: Path, *, labelled: bool) -> dict[str, str]:
        """The names in a file's path, by `object`, `session` and `split`.

        Raises:
            UserError: the path is of a different pattern, or names no object where it is `labelled`.
        """
        recording = place_of(file, self.root)
        pattern = re.sub("SESSION|SPLIT", lambda part: f"(?P<{part[0].lower()}>[^/]+?)", re.escape(self.text))
        pattern = pattern.replace("OBJECT", "(?P<object>[^/]+)").replace("FILE", "[^/]+")  # tea_box is one name
        if not (match := re.fullmatch(pattern, recording)):
            expected = f"expected {self.text} as for most files; in all, {PLACES}"
            raise UserError(f"{file}: {expected}, or an attribute `object` in HDF5")
        if labelled and "object" not in match.groupdict():
            raise UserError(
                f"{self.root}: {file.relative_to(self.root).as_posix()!r} names no object; expected {PLACES}, a table "
                "with a column `object`, or an attribute `object` in HDF5; "
                f"{setting('data.layout=OBJECT_FILE')} for names such as mug_1.csv"
            )
        return match.groupdict()


def place_of(file: Path, path: Path) -> str:
    """The path of a file below a folder, without its ending: the name of its recording; of a file alone its name."""
    place = file.name if file == path else file.relative_to(path).as_posix()
    return re.sub(r"(?i)(\.csv)?\.\w+$", "", place)


def layout_of(path: Path, files: Sequence[Path], form: Form) -> Layout:
    """The layout of the files below a folder, or of one file: the given one, or by `auto` that of most files.

    Folders that are all called as sides are the published split. Of the others the innermost is the object and the one
    above it the session: a file train/monday/mug/1.npy is SPLIT/SESSION/OBJECT/FILE.

    Raises:
        UserError: most files lie deeper than that.
    """
    root = path if path.is_dir() else path.parent
    if form.layout != "auto":
        return Layout(root, form.layout)
    places = [file.relative_to(root).parts[:-1] for file in files]
    depth = Counter(map(len, places)).most_common(1)[0][0]
    levels = list(zip(*(place for place in places if len(place) == depth), strict=True))
    are_sides = [{name.lower() for name in level} <= SPLITS.keys() for level in levels]
    count = are_sides.count(False)
    if count > 2:
        raise UserError(f"{root}: {'/'.join(files[0].relative_to(root).parts)!r} names no object; expected {PLACES}")
    roles = iter(["SESSION", "OBJECT"][2 - count :])
    order = ["SPLIT" if is_side else next(roles) for is_side in are_sides]
    layout = Layout(root, "/".join([*order, "FILE"]))
    if not levels:
        return layout
    text = f"folders are in the order {layout.text}: "
    text += ", ".join(f"{level[0]} is the {role.lower()}" for level, role in zip(levels, order, strict=True))
    if count < 2 or EMPTY_HAND in levels[order.index("OBJECT")]:
        return Layout(root, layout.text, (Note(text, topic="folders"),))
    other = "/".join({"SESSION": "OBJECT", "OBJECT": "SESSION"}.get(role, role) for role in order)
    text += f". If not, {setting(f'data.layout={other}/FILE')}; else data.layout={layout.text}"
    return Layout(root, layout.text, (Note(text, "warning", "folders"),))
