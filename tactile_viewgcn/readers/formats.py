"""Finding out in which form a path holds recordings, and opening them: STAG's, one table of all, or one file each."""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path, PureWindowsPath

import h5py
import numpy as np

from tactile_viewgcn.files import all_below, home_path
from tactile_viewgcn.messages import Note, UserError, listed, once_each, several
from tactile_viewgcn.readers.arrays import (
    Hdf5File,
    matlab_fields,
    read_metadata,
    read_raw,
    recordings_of_arrays,
)
from tactile_viewgcn.readers.child import library, reading
from tactile_viewgcn.readers.join import joined, side_by_side
from tactile_viewgcn.readers.layout import (
    PLACES,
    doubles_notes,
    layout_of,
    names_in,
    names_of,
    place_of,
)
from tactile_viewgcn.readers.recurring import session_notes
from tactile_viewgcn.readers.source import (
    ATTRIBUTES_TOPIC,
    AUTO,
    UNLABELLED,
    Form,
    Recording,
    Source,
    Values,
    check_shape,
    framed,
    label_text,
    setting,
    side_of,
)
from tactile_viewgcn.readers.text import Table, label_kind, read_table, recordings_in

TEXTS = (".csv", ".tsv", ".csv.gz", ".txt")  # endings of tables as text
HDF5, ARRAYS = (".h5", ".hdf5"), (".npy", ".npz", ".mat")
MOST_HEADER = 100_000  # letters of a table's first line
FEW_ROWS = 10  # of a frame; so few frames are no recording
AS_WINDOWS = "save X (n, frames, channels) and y (n,) by numpy.savez('all.npz', X=X, y=y)"
EXPECTED = f"expected a STAG metadata.mat or folder, a folder of {PLACES} with .npy, .npz, .mat, .csv, .txt or .h5, or "
EXPECTED += "a .csv with a column `object` (see the manual's page on data)"


def files_of(path: Path) -> list[Path]:
    """A file itself, or all files below a folder, see `all_below`."""
    return all_below(path) if path.is_dir() else [path]


def among(files: Sequence[Path], *endings: str) -> list[Path]:
    """The files with one of these endings."""
    return [file for file in files if file.name.lower().endswith(endings)]


def open_source(path: str | Path, form: Form = AUTO) -> Source:
    """The source at a path: STAG's metadata.mat or folder, or recordings in HDF5, arrays and tables.

    A damaged file may crash this process; `read_source` uses a separate one.

    Args:
        form: of recordings that are not STAG's.

    Raises:
        FileNotFoundError: nothing is at that path.
        UserError: a file is of none of these forms, or damaged.
    """
    path, is_hdf5 = Path(path), False
    if not path.exists() and not path.is_symlink():
        home = home_path(path)
        what = EXPECTED if home == str(path) else f"~ is not expanded here; write {home}"
        raise FileNotFoundError(f"{path}: no such file or folder; {what}")
    files = files_of(path)
    raw = [
        file
        for file in files
        if file.name == "pressuredata.mat" and len(file.relative_to(path).parts) == 3
    ]
    if raw:
        return joined(path, [[file] for file in raw], lambda group: [read_raw(group[0])], "")
    if not path.is_dir():
        with reading(path):
            is_hdf5, is_matlab = h5py.is_hdf5(path), path.suffix.lower() == ".mat"
            fields: Iterable[str] = ()
            if is_hdf5:
                fields = Hdf5File(path)
            elif is_matlab:
                fields = matlab_fields(path)
            if path.name == "metadata.mat" or "objectId" in fields:
                return read_metadata(path)
    recordings = [path] if is_hdf5 else among(files, *HDF5, *ARRAYS, *TEXTS)
    if not recordings:
        found = endings_of(files) or "nothing"
        pointers = "; if DVC keeps them: dvc pull" if among(files, ".dvc") else ""
        raise UserError(f"{path}: no recordings in it, found {found}{pointers}; {EXPECTED}")
    return read_files(
        path, recordings, form, [file for file in files if file not in set(recordings)]
    )


class LastTable:
    """Tables of text files by `read_table`, of which the last one is kept: a file alone is not read twice.

    Args:
        form: as which they are read.
    """

    def __init__(self, form: Form):
        self._form = form
        self._file: Path | None = None
        self._table: Table | None = None

    def __call__(self, file: Path) -> Table:
        """The table in a file."""
        if self._table is None or file != self._file:
            self._table = None  # before the next one is read: one is in memory at a time
            self._table = read_table(file, self._form)
            self._file = file
        return self._table


def read_files(path: Path, files: list[Path], form: Form, unread: list[Path]) -> Source:
    """Files below a folder, or a single one: a recording each, or tables whose columns name recordings.

    Folders name objects and sessions, see `layout_of`, but for those of HDF5 files with an
    attribute `object`. Files of text that hold no table are left out; a note counts them and those
    `unread` for their endings.
    """
    table, left = LastTable(form), dict[Path, str]()
    for file in among(files, ".txt"):
        try:
            with reading(file):
                table(file)
        except UserError as error:
            left[file] = str(error)
    files = [file for file in files if file not in left]
    if not files:
        raise UserError(listed(once_each(left.items()), "; "))
    root = path if path.is_dir() else path.parent
    tables, labels = labels_in(files)
    if not (files := [file for file in files if file not in tables]):
        raise UserError(
            f"{path}: no recordings beside {listed([table.name for table in tables])}; {EXPECTED}"
        )
    layout, guessed = layout_of([place_of(file, root) for file in files], form)
    in_paths = {file: names_in(place_of(file, root), layout) for file in files}
    shapes = dict[Path, tuple[int, ...]]()

    def object_of(file: Path) -> str | None:
        """The object in a file's path; None of a file that lies elsewhere."""
        if labels:
            return labels.get(file.stem, {}).get("object")
        names = names_in(place_of(file, root), layout)
        return names.get("object", None if form.labelled else "") if names else None

    def parts_of(file: Path) -> list[Recording]:
        """The recordings in a file, with the names that stand in it."""
        if not among([file], *TEXTS):
            return recordings_of_arrays(file, form)
        (recording, columns), is_one = table(file), len(files) == 1
        if is_one and "object" in columns:
            return recordings_in(recording, columns, "")
        is_all = not form.labelled if is_one else "object" in columns and not object_of(file)
        return recordings_in(recording, columns, place_of(file, path)) if is_all else [recording]

    def opened(file: Path) -> list[Recording]:
        """The recordings in a file, with the names in its path where it holds one alone that names no object."""
        recordings, parts = list[Recording](), parts_of(file)
        for part in parts:
            names, notes = labels.get(file.stem, {}) | part.names, part.notes
            in_path = {
                kind: text for kind, text in in_paths[file].items() if kind in ("part", "recording")
            }
            if (
                len(parts) == 1
                and not names.get("object")
                and (form.labelled or among([file], *TEXTS, *ARRAYS))
            ):
                in_path = names_of(file, root, layout, form, partial(hint_of, part))
                notes = [*notes, *guessed]
            names = (
                {"recording": place_of(file, path), "object": UNLABELLED, "session": "session"}
                | in_path
                | names
            )
            names |= {kind: label_text(names[kind]) for kind in ("object", "session")}
            if among([file], *ARRAYS):
                shapes[file] = tuple(part.values["pressure"].shape)
            values = part.values | {"pressure": framed(part.values["pressure"], form, str(file))}
            side = names.pop("split", "")
            code = side_of(side) if side else None
            if side and code is None:
                raise UserError(f"{file}: split is {side!r}; expected train, test or validation")
            for name, frames in stacked(values, names["recording"], str(file)).items():
                if code is not None:
                    frames = frames | {"split": np.full(len(frames["pressure"]), code)}
                recordings.append(
                    replace(part, names=names | {"recording": name}, values=frames, notes=notes)
                )
        return recordings

    groups, left_out = dict[str, list[Path]](), set[str]()
    for file in files:
        groups.setdefault(in_paths[file].get("recording", str(file)), []).append(file)

    def whole(group: list[Path]) -> list[Recording]:
        """The recordings in one file, or the one in files that are joined."""
        first = next(iter(groups.values()))
        parts, usual = (
            [in_paths[file].get("part", "none") for file in each] for each in (group, first)
        )
        if parts != usual or len({*parts}) < len(parts):
            expected = f"expected {listed([*dict.fromkeys(usual)])} once each, as by {first[0]}"
            raise UserError(
                f"{group[0]}: PART is {listed(parts)}; {expected}; {setting('data.layout=auto')}"
            )
        recordings = {group[0]: opened(group[0])}
        for file in group[1:]:
            with reading(file):
                recordings[file] = opened(file)
        whole_ones = side_by_side(recordings, form)
        left_out.update(name for each in whole_ones for name in each.left_out)
        return whole_ones

    source = joined(path, [*groups.values()], whole, layout)
    if form.labelled and (missing := [name for name in form.left_out if name not in left_out]):
        raise UserError(
            f"{path}: no column {missing[0]!r} in any file; sensors are {listed(source.channel_names)}"
        )
    source.notes.extend(unread_note(path, files, dict.fromkeys(unread, "") | left, object_of))
    if form.labelled:
        places = [place_of(file, root) for file in files]
        if not labels:
            source.notes.extend(stack_notes(shapes, layout, root, form))
        source.notes.extend(doubles_notes(places, path))
        if len(source.names["session"]) == 1:
            objects = [object_of(file) for file in files]
            source.notes.extend(session_notes(places, objects, layout, has_labels=bool(labels)))
    return source


def stacked(values: Values, name: str, where: str) -> dict[str, Values]:
    """The values of the recordings in one array by their names: of `name` alone, or of n recordings (n, T, H, W)."""
    pressure = values["pressure"]
    if len(pressure.shape) != 4:
        check_shape(pressure.shape, where)
        return {name: values}
    if len(values) > 1:
        raise UserError(
            f"{where}: {len(pressure):,} recordings with times or flags of one; save each as its own file"
        )
    return {f"{name}/{number}": {"pressure": frames} for number, frames in enumerate(pressure[()])}


def hint_of(recording: Recording) -> str:
    """Which column or attribute may have the objects that no path names, and what to type then; "" without one.

    A column is one of whole numbers, with the fewest different ones: two at least, and at most half
    as many as lines.
    """
    attributes = [note.text for note in recording.notes if note.topic == ATTRIBUTES_TOPIC]
    if attributes:
        return attributes[0]
    pressure = recording.values["pressure"]
    if len(pressure.shape) != 2 or not len(pressure):
        return ""
    table = np.asarray(pressure[()], dtype=np.float64)
    names = recording.channel_names or [""] * table.shape[1]
    counts = dict[int, int]()
    for at, column in enumerate(table.T):
        count = len(np.unique(column))
        if 2 <= count <= len(column) / 2 and not (column % 1).any():
            counts[at] = count
    text = "each line is read as one frame"
    if counts:
        best = min(counts, key=lambda at: counts[at])
        key = names[best] or str(best + 1)
        what = f"column {key!r} holds {counts[best]} whole numbers"
        text += f"; {what}: if these are the objects, {setting(f'data.columns=[object:{key}]')}"
    return f"{text}; if a line is a whole recording, {AS_WINDOWS}"


def stack_notes(
    shapes: Mapping[Path, tuple[int, ...]], layout: str, root: Path, form: Form
) -> list[Note]:
    """A warning where arrays (n, T, C) that are read as n frames of T rows may be n recordings of T frames.

    They may be where each object has one array, or one a side, or where no array has as many frames
    as rows. Squares are grids, and so are frames of few rows.

    Args:
        shapes: of the arrays by their files.
        form: as which they are read; a shape in it says what they are.
    """
    files = {file: shape for file, shape in shapes.items() if len(shape) == 3}
    if form.shape != "auto" or not files or len(files) < len(shapes):
        return []
    if any(rows < FEW_ROWS or rows == columns for _, rows, columns in files.values()):
        return []
    of_object = Counter[tuple[str | None, int | None]]()
    for file in files:
        place = place_of(file, root)
        of_object[names_in(place, layout).get("object"), side_of(place.rpartition("/")[2])] += 1
    one_each = max(of_object.values()) == 1 and len(of_object) > 1
    if not one_each and any(frames >= rows for frames, rows, _ in files.values()):
        return []
    file, (count, rows, columns) = next(iter(files.items()))
    text = (
        f"{place_of(file, root)}, an array {(count, rows, columns)}, is read as one recording of "
    )
    text += f"{several(count, 'frame')} of {rows} x {columns}. If it holds {several(count, 'recording')} of "
    text += f"{several(rows, 'frame')}, {setting(f'data.shape=[1,{columns}]')}; if not, data.shape=[{rows},{columns}]."
    return [Note(text, "warning", "shape")]


def labels_in(files: Sequence[Path]) -> tuple[list[Path], dict[str, dict[str, str]]]:
    """The tables among files that name files and their objects, as labels.csv; and the names by a file's own name."""
    tables, names = list[Path](), dict[str, dict[str, str]]()
    for file in among(files, ".csv", ".tsv"):
        with reading(file), file.open(encoding="utf-8-sig", errors="replace") as stream:
            header = [
                name.strip(' "\n') for name in re.split("[,;\t]", stream.readline(MOST_HEADER))
            ]
        kinds = dict[str, str]()
        for name in header:
            kind = label_kind(name)
            if kind in ("object", "session") and kind not in kinds.values():
                kinds[name] = kind
        column = next(
            (
                name
                for name in header
                if re.fullmatch(r"file[ _]?(name|path)?s?|path", name.lower())
            ),
            None,
        )
        if column is None or "object" not in kinds.values():
            continue
        import pandas as pd  # here, since it loads slowly

        with library(file):
            table = pd.read_csv(
                file, sep=None, engine="python", dtype=str, keep_default_na=False
            ).rename(columns=kinds)
        tables.append(file)
        for place, row in zip(
            table[column], table[[*kinds.values()]].to_dict("records"), strict=True
        ):
            stem, row = (
                PureWindowsPath(place).stem,
                {str(kind): label_text(name) for kind, name in row.items()},
            )
            if names.setdefault(stem, row) != row:
                raise UserError(
                    f"{file}: {stem} has two labels; expected a name of its own for each file"
                )
    return tables, names


def unread_note(
    path: Path,
    files: Sequence[Path],
    unread: Mapping[Path, str],
    object_of: Callable[[Path], str | None],
) -> list[Note]:
    """A note on the number of files below a folder that are not read; a warning where an object lacks recordings so.

    A file that is called as one of `files`, which are read, but for its ending, is no recording
    more. `unread` has what is wrong in each of the others, "" where its ending says it.
    """
    if not unread:
        return []
    known, read = {place_of(file, path) for file in files}, Counter(map(object_of, files))
    lost = Counter(object_of(file) for file in unread if place_of(file, path) not in known)
    lost.pop(None, None)
    reasons = listed([endings_of(list(unread)), *filter(None, unread.values())], "; ")
    text = f"{several(len(unread), 'file')} not read ({reasons})"
    if not lost:
        return [Note(f"{text}.", topic="files")]
    parts = [
        f"{name} {read[name]} of {read[name] + count}".strip()
        for name, count in sorted(lost.items())
    ]
    text += f". Read of the files that lie there: {listed(parts)}. Save the others as .npy or .csv, or move them away."
    return [Note(text, "warning", "files")]


def endings_of(files: Sequence[Path]) -> str:
    """Number of files of each ending, such as `12 .json, 1 .md`."""
    counts = Counter(file.suffix.lower() or file.name for file in files)
    return listed([f"{count:,} {ending}" for ending, count in counts.most_common()])
