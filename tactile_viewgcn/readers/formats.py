"""Finding out in which form a path holds recordings, and opening them: STAG's, one table of all, or one file each."""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path, PureWindowsPath

import h5py
import numpy as np

from tactile_viewgcn.files import all_below
from tactile_viewgcn.messages import Note, UserError, listed, once_each, several
from tactile_viewgcn.readers.arrays import matlab_fields, open_hdf5, read_metadata, read_raw, recordings_of_arrays
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.join import joined, side_by_side
from tactile_viewgcn.readers.layout import PLACES, layout_of, names_in, names_of, place_of
from tactile_viewgcn.readers.source import AUTO, UNLABELLED, Form, Recording, Source, framed, setting, side_of, tidy
from tactile_viewgcn.readers.text import CONTENTS, read_table, recordings_in

TEXTS = (".csv", ".tsv", ".csv.gz", ".txt")  # endings of tables as text
HDF5, ARRAYS = (".h5", ".hdf5"), (".npy", ".npz", ".mat")
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
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder; {EXPECTED}")
    files = files_of(path)
    raw = [file for file in files if file.name == "pressuredata.mat" and len(file.relative_to(path).parts) == 3]
    if raw:
        return joined(path, [[file] for file in raw], lambda group: [read_raw(group[0])], "")
    if not path.is_dir():
        with reading(path):
            is_hdf5, is_matlab = h5py.is_hdf5(path), path.suffix.lower() == ".mat"
            fields = open_hdf5(path) if is_hdf5 else matlab_fields(path) if is_matlab else ()
            if path.name == "metadata.mat" or "objectId" in fields:
                return read_metadata(path)
    recordings = [path] if is_hdf5 else among(files, *HDF5, *ARRAYS, *TEXTS)
    if not recordings:
        raise UserError(f"{path}: no recordings in it, found {endings_of(files) or 'nothing'}; {EXPECTED}")
    return read_files(path, recordings, form, [file for file in files if file not in set(recordings)])


def read_files(path: Path, files: list[Path], form: Form, unread: list[Path]) -> Source:
    """Files below a folder, or a single one: a recording each, or tables whose columns name recordings.

    Folders name objects and sessions, see `layout_of`, but for those of HDF5 files with an attribute `object`. Files of
    text that hold no table are left out; a note counts them and those `unread` for their endings.
    """
    table, left = cache(partial(read_table, form=form)), dict[Path, str]()
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
        raise UserError(f"{path}: no recordings beside {listed([table.name for table in tables])}; {EXPECTED}")
    layout, guessed = layout_of([place_of(file, root) for file in files], form)
    in_paths = {file: names_in(place_of(file, root), layout) for file in files}

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
            in_path = {kind: text for kind, text in in_paths[file].items() if kind in ("part", "recording")}
            if len(parts) == 1 and not names.get("object") and (form.labelled or among([file], *TEXTS, *ARRAYS)):
                in_path, notes = names_of(file, root, layout, form), [*notes, *guessed]
            names = {"recording": place_of(file, path), "object": UNLABELLED, "session": "session"} | in_path | names
            names |= {kind: tidy(names[kind]) for kind in ("object", "session")}
            values = part.values | {"pressure": framed(part.values["pressure"], form, str(file))}
            if side := names.pop("split", ""):
                if (code := side_of(side)) is None:
                    raise UserError(f"{file}: split is {side!r}; expected train, test or validation")
                values |= {"split": np.full(len(values["pressure"]), code)}
            recordings.append(replace(part, names=names, values=values, notes=notes))
        return recordings

    groups, left_out = dict[str, list[Path]](), set[str]()
    for file in files:
        groups.setdefault(in_paths[file].get("recording", str(file)), []).append(file)

    def whole(group: list[Path]) -> list[Recording]:
        """The recordings in one file, or the one in files that are joined."""
        first = next(iter(groups.values()))
        parts, usual = ([in_paths[file].get("part", "none") for file in each] for each in (group, first))
        if parts != usual or len({*parts}) < len(parts):
            expected = f"expected {listed([*dict.fromkeys(usual)])} once each, as by {first[0]}"
            raise UserError(f"{group[0]}: PART is {listed(parts)}; {expected}; {setting('data.layout=auto')}")
        recordings = {group[0]: opened(group[0])}
        for file in group[1:]:
            with reading(file):
                recordings[file] = opened(file)
        whole_ones = side_by_side(recordings, form.left_out)
        left_out.update(name for each in whole_ones for name in each.left_out)
        return whole_ones

    source = joined(path, [*groups.values()], whole, layout)
    if form.labelled and (missing := [name for name in form.left_out if name not in left_out]):
        raise UserError(f"{path}: no column {missing[0]!r} in any file; sensors are {listed(source.channel_names)}")
    source.notes.extend(unread_note(path, files, dict.fromkeys(unread, "") | left, object_of))
    return source


def labels_in(files: Sequence[Path]) -> tuple[list[Path], dict[str, dict[str, str]]]:
    """The tables among files that name files and their objects, as labels.csv; and the names by a file's own name."""
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


def unread_note(
    path: Path, files: Sequence[Path], unread: Mapping[Path, str], object_of: Callable[[Path], str | None]
) -> list[Note]:
    """A note on the number of files below a folder that are not read; a warning where an object lacks recordings so.

    A file that is called as one of `files`, which are read, but for its ending, is no recording more. `unread` has what
    is wrong in each of the others, "" where its ending says it.
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
    parts = [f"{name} {read[name]} of {read[name] + count}".strip() for name, count in sorted(lost.items())]
    text += f". Read of the files that lie there: {listed(parts)}. Save the others as .npy or .csv, or move them away."
    return [Note(text, "warning", "files")]


def endings_of(files: Sequence[Path]) -> str:
    """Number of files of each ending, such as `12 .json, 1 .md`."""
    counts = Counter(file.suffix.lower() or file.name for file in files)
    return listed([f"{count:,} {ending}" for ending, count in counts.most_common()])
