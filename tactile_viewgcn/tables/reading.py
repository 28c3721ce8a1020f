"""Read each file of a source once, and append its frames to a table.

The names of objects, recordings and sessions, and their numbers, are decided at the end, when the
contents of all files are known. Memory holds the frames of one file, or of the files that are
joined to one recording, and the other columns of all files.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tactile_viewgcn.messages import Note, UserError, listed, once_each
from tactile_viewgcn.params import SIDES, TRAIN
from tactile_viewgcn.readers.catalogue import add_labels, names_in_text
from tactile_viewgcn.readers.child import UNPACKED, UNPACKED_TIMES, check_unpacked, reading
from tactile_viewgcn.readers.discovery import EXPECTED, Source, bytes_of
from tactile_viewgcn.readers.formats import TEXTS, has_ending, read_file
from tactile_viewgcn.readers.join import doubled, side_by_side, unlike
from tactile_viewgcn.readers.layout import layout_of, names_in
from tactile_viewgcn.readers.lines import recordings_of_lines
from tactile_viewgcn.readers.naming import Found, Named, Naming, catalogue_of, ids_of
from tactile_viewgcn.readers.notes import source_notes
from tactile_viewgcn.readers.source import (
    COLUMNS,
    Form,
    Recording,
    check_values,
    framed,
    setting,
    stacked,
)
from tactile_viewgcn.readers.text import read_text, table_in
from tactile_viewgcn.tables.columns import columns_of, fault_text, first_fault
from tactile_viewgcn.tables.counts import write_columns
from tactile_viewgcn.tables.writing import CountsFile, Fault

COLUMN_BYTES = 32  # bytes of the columns of one frame in a table
# smallest range of the sensor that varies most; see MAX_PRESSURE in readers/source.py
MIN_SPREAD = 1e-30


@dataclass(frozen=True)
class Group:
    """The files of one recording; most recordings have one file.

    Attributes:
        files: the files in order.
        parts: the part of the sensors in each file, such as ["left", "right"]. It is [""] if
            neither the layout nor a catalogue names parts.
    """

    files: list[Path]
    parts: list[str]


def groups_of(source: Source, form: Form) -> list[Group]:
    """Return the files of a source in groups; the files of a group are joined to one recording.

    A catalogue that is the source decides which files are joined, or else a PART in the layout.
    """
    keys = {file: (str(file), "") for file in source.files}
    if source.given is not None:
        for row in source.given.to_dict("records"):
            if row.get("part") and row.get("recording"):
                keys[row["path"]] = (row["recording"], row["part"])
    elif "PART" in form.layout:
        layout, _ = layout_of([source.place_of(file) for file in source.files], form)
        for file in source.files:
            names = names_in(source.place_of(file), layout)
            keys[file] = (names.get("recording", str(file)), names.get("part", "none"))
    groups = dict[str, Group]()
    for file, (key, part) in keys.items():
        group = groups.setdefault(key, Group([], []))
        group.files.append(file)
        group.parts.append(part)
    return list(groups.values())


@dataclass(frozen=True)
class _Framed:
    """A recording with pressure (T, H, W).

    Attributes:
        recording: the recording.
        axes: the shape of the array in its file, from which the frames were made.
        is_only_array: whether its file holds no other array or table, see `Found`.
    """

    recording: Recording
    axes: tuple[int, ...]
    is_only_array: bool


@dataclass(frozen=True)
class Contents:
    """The contents of a source.

    Attributes:
        recordings: the recordings with their names, in the order of their frames.
        channel_names: the names of the sensors, row after row; empty if they have none.
        notes: how files were read, and what was left out.
        unread: the mistake in each file that was not read, "" if only its ending is the reason.
        fault: the first reading out of range, if there is one. `write_recordings` refuses it.
    """

    recordings: list[Named]
    channel_names: list[str]
    notes: list[Note]
    unread: dict[Path, str]
    fault: Fault | None


class SourcePass:
    """One pass over the files of a source, at the end of which all recordings get their names.

    Args:
        source: the source.
        form: the form in which its files are read.
        counts: the file to which frames are appended.
    """

    def __init__(self, source: Source, form: Form, counts: CountsFile):
        self._source = source
        self._form = form
        self._counts = counts
        self._found = list[Found]()
        self._mistakes = dict[Path, str]()
        self._unread_texts = dict[Path, str]()  # the mistake in each file
        self._label_tables = dict[Path, pd.DataFrame]()
        self._left_out = set[str]()
        self._frames = 0  # including frames that are not written
        self._first: Group | None = None
        self._stored = bytes_of(source.files)
        self._given = dict[Path, pd.DataFrame]()  # the catalogue's rows of each file
        if source.given is not None:
            self._given = dict(list(source.given.groupby("path", sort=False)))

    def read(self) -> None:
        """Read all files, and keep their mistakes until the end."""
        for group in groups_of(self._source, self._form):
            try:
                self._read_group(group)
            except UserError as error:
                self._mistakes[group.files[0]] = str(error)

    def _read_group(self, group: Group) -> None:
        """Read the files of one group, and keep the recordings in them."""
        contents = dict[Path, list[_Framed]]()
        parts = list[str]()
        for file, part in zip(group.files, group.parts, strict=True):
            recordings = self._recordings_in(file)
            if recordings is not None:
                contents[file] = self._framed(file, recordings)
                parts.append(part)
        if not contents:
            return
        files = list(contents)
        self._check_parts(Group(files, parts))
        if self._given and any(parts):
            # a catalogue can list the parts of each recording in another order
            files, parts = self._in_usual_order(files, parts)
            contents = {file: contents[file] for file in files}
        if len(files) == 1:
            for framed_one in contents[files[0]]:
                self._keep(files, parts, framed_one)
            return
        for file, recordings_of_file in contents.items():
            if len(recordings_of_file) > 1:
                count = f"{len(recordings_of_file)} recordings"
                raise UserError(f"{file}: {count}; expected one in each file that is joined")
        framed_ones = [recordings_of_file[0] for recordings_of_file in contents.values()]
        recordings = [framed_one.recording for framed_one in framed_ones]
        joined = side_by_side(files, parts, recordings, self._form)
        self._keep(files, parts, replace(framed_ones[0], recording=joined))

    def _recordings_in(self, file: Path) -> list[Recording] | None:
        """Return the recordings in a file, or None if the file counts as no recording.

        A labels.csv counts as no recording. Neither does a .txt with a mistake, since many folders
        hold a readme.txt; `_unread_texts` keeps the mistake. An exception is a .txt that a
        catalogue names.

        Raises:
            UserError: any other file has a mistake, or a .txt that a catalogue names has one.
        """
        try:
            with reading(file):
                if not has_ending(file, TEXTS):
                    return read_file(file, self._form)
                return self._recordings_in_text(file)
        except UserError as error:
            if self._given or not has_ending(file, [".txt"]):
                raise
            self._unread_texts[file] = str(error)
            return None

    def _recordings_in_text(self, file: Path) -> list[Recording] | None:
        """Return the table in a text as one recording; None for a labels.csv.

        If a catalogue names recordings by their `place` in the table, return these recordings.
        """
        text = self._source.texts.pop(file, None)
        if text is None:
            text = read_text(file)
        if not self._given and has_ending(file, [".csv", ".tsv"]):
            names = names_in_text(file, text)
            if names is not None:
                self._label_tables[file] = names
                return None
        table = table_in(file, text, self._form)
        if self._given and (self._given[file]["place"] != "").any():
            return recordings_of_lines(table, self._source.place_of(file))
        return [table]

    def _framed(self, file: Path, recordings: list[Recording]) -> list[_Framed]:
        """Return the recordings in a file with pressure (T, H, W).

        If a catalogue is the source, return only the recordings that it names.
        """
        framed_ones = list[_Framed]()
        is_only_array = len(recordings) == 1
        for recording in recordings:
            pressure = recording.values["pressure"]
            axes = tuple(pressure.shape)
            if not recording.is_framed:
                pressure = framed(pressure, self._form, str(file))
            recording = replace(recording, values=recording.values | {"pressure": pressure})
            for part in stacked(recording, str(file)):
                framed_ones.append(_Framed(part, axes, is_only_array=is_only_array))
        if not self._given:
            return framed_ones
        return self._given_only(file, framed_ones)

    def _given_only(self, file: Path, framed_ones: list[_Framed]) -> list[_Framed]:
        """Return the recordings of a file that a catalogue names."""
        by_place = {framed_one.recording.place: framed_one for framed_one in framed_ones}
        rows = self._given[file]
        for line, place in zip(rows["line"], rows["place"], strict=True):
            if place in by_place:
                continue
            where = f"{self._source.path}: line {line}"
            found = listed([repr(known) for known in by_place])
            if place:
                raise UserError(f"{where}: {file} has no recording {place!r}; found {found}")
            what = f"{file} holds {len(by_place)} recordings"
            raise UserError(f"{where}: {what}; write in `place` which one it is: {found}")
        named = set(rows["place"])
        return [framed_one for framed_one in framed_ones if framed_one.recording.place in named]

    def _check_parts(self, group: Group) -> None:
        """Refuse a recording whose parts differ from the parts of the first recording."""
        if not any(group.parts):
            return
        if self._first is None:
            self._first = group
        usual = self._first.parts
        parts = group.parts
        if self._given:
            parts = sorted(parts, key=lambda part: usual.index(part) if part in usual else -1)
        if parts == usual and len(set(parts)) == len(parts):
            return
        expected = f"{listed([*dict.fromkeys(usual)])} once each, as for {self._first.files[0]}"
        what = f"PART is {listed(group.parts)}; expected {expected}"
        remedy = setting("data.layout=auto")
        if self._given:
            remedy = "write the same parts for each recording"
        raise UserError(f"{group.files[0]}: {what}; {remedy}")

    def _in_usual_order(self, files: list[Path], parts: list[str]) -> tuple[list[Path], list[str]]:
        """Return the files of a recording in the order of the first recording's parts."""
        if self._first is None:
            return files, parts
        file_of_part = dict(zip(parts, files, strict=True))
        usual = self._first.parts
        return [file_of_part[part] for part in usual], list(usual)

    def _keep(self, files: list[Path], parts: list[str], framed_one: _Framed) -> None:
        """Append the frames of a recording to the counts, and keep everything else."""
        recording = framed_one.recording
        self._left_out.update(recording.left_out)
        shape, dtype = check_values(recording.values, str(files[0]))
        columns = dict(recording.values)
        pressure = columns.pop("pressure")
        columns = {name: np.asarray(values[()]) for name, values in columns.items()}
        self._frames += len(pressure)
        is_written = self._counts.shape in (None, shape) and self._has_room(shape, dtype)
        first = self._counts.frames
        if is_written:
            self._counts.append(pressure, dtype)
        found = Found(
            files,
            parts,
            replace(recording, values=columns),
            is_only_array=framed_one.is_only_array,
            axes=framed_one.axes,
            shape=shape,
            dtype=dtype,
            first=first,
            frames=len(pressure),
            is_written=is_written,
        )
        self._found.append(found)

    def _has_room(self, shape: tuple[int, int], dtype: np.dtype) -> bool:
        """Return whether all frames so far take no more room than their files may unpack to."""
        return self._bytes(shape, dtype) <= UNPACKED + UNPACKED_TIMES * self._stored

    def _bytes(self, shape: tuple[int, int], dtype: np.dtype) -> int:
        return self._frames * (prod(shape) * dtype.itemsize + COLUMN_BYTES)

    def finish(self) -> Contents:
        """Return the contents of the source, with all names.

        A reading out of range is no error here, see `Contents.fault`.

        Raises:
            UserError: files cannot be read, differ from most others, or have the name of an earlier
                recording; the error lists them. Or there are no frames, or they take far more room
                than their files.
        """
        naming = self._naming()
        recordings = self._named(naming)
        if self._frames == 0 or self._counts.shape is None:
            what = "no frames; expected at least one recording with frames"
            raise UserError(f"{self._source.path}: {what}")
        dtype = np.result_type(*{found.dtype for found in self._found})
        unpacked = self._bytes(self._counts.shape, dtype)
        check_unpacked(self._source.path, unpacked, self._stored)
        channels = recordings[0].found.recording.channel_names
        if len(channels) != prod(self._counts.shape):
            channels = []
        self._check_left_out(channels)
        unread = dict.fromkeys(self._source.unread, "") | self._unread_texts
        notes = source_notes(self._source, recordings, naming, self._form, unread=unread)
        fault = self._counts.fault
        if dtype.kind == "i":
            fault = self._counts.integer_fault
        return Contents(recordings, channels, notes, unread, fault)

    def _naming(self) -> Naming:
        """Return the `Naming` of the files that hold recordings."""
        files = [file for file in self._source.files if file not in self._unread_texts]
        if not files:
            raise UserError(listed(once_each(self._unread_texts.items()), "; "))
        labels = dict[str, dict[str, str]]()
        for table, rows in self._label_tables.items():
            add_labels(labels, table, rows)
        files = [file for file in files if file not in self._label_tables]
        if not files:
            tables = listed([table.name for table in self._label_tables])
            raise UserError(f"{self._source.path}: no recordings besides {tables}; {EXPECTED}")
        return Naming(self._source, files, labels, self._form)

    def _named(self, naming: Naming) -> list[Named]:
        """Return all recordings with their names.

        Raises:
            UserError: lists the files with mistakes.
        """
        recordings = list[Named]()
        mistakes = dict(self._mistakes)
        for found in self._found:
            try:
                recordings += naming.named(found, self._counts.read)
            except UserError as error:
                mistakes[found.file] = str(error)
        order = {file: number for number, file in enumerate(self._source.files)}
        mistakes = dict(sorted(mistakes.items(), key=lambda item: order[item[0]]))
        if self._source.given is not None:
            recordings = _with_splits(recordings)
        mistakes = doubled(recordings) | mistakes
        for file, text in unlike(recordings).items():
            mistakes.setdefault(file, text)
        if mistakes:
            raise UserError(listed(once_each(mistakes.items()), "; "))
        return recordings

    def _check_left_out(self, channels: list[str]) -> None:
        """Refuse a `leave_out` of a column that no file has."""
        if not self._form.labelled or self._found[0].recording.is_framed:
            return
        missing = [name for name in self._form.left_out if name not in self._left_out]
        if missing:
            what = f"no column {missing[0]!r} in any file; sensors are {listed(channels)}"
            raise UserError(f"{self._source.path}: {what}")


def _with_splits(recordings: list[Named]) -> list[Named]:
    """Return the recordings of a catalogue, all with a published set if any of them has one.

    The set of a recording that has none is then the training set.
    """
    if not any(recording.has_split for recording in recordings):
        return recordings
    filled = list[Named]()
    for recording in recordings:
        if not recording.has_split:
            names = recording.names | {"split": SIDES[TRAIN]}
            recording = replace(recording, names=names)
        filled.append(recording)
    return filled


def write_recordings(folder: Path, source: Source, form: Form) -> pd.DataFrame:
    """Write the frames of a source to a table, and return its catalogue.

    Args:
        folder: the folder of the table.
        source: the source, from `discover`.
        form: the form in which its files are read.

    Raises:
        UserError: a value is out of range, or the readings vary too little. `SourcePass.finish`
            raises it too.
    """
    counts = CountsFile(folder)
    source_pass = SourcePass(source, form, counts)
    source_pass.read()
    contents = source_pass.finish()
    ids = ids_of(contents.recordings)
    columns = columns_of(contents.recordings, ids, counts.frames)
    fault = first_fault(columns, ids, contents.fault)
    if fault is not None:
        raise UserError(fault_text(source.path, fault, columns, ids["recording"]))
    _check_spread(source.path, counts)
    _sort_lines(contents.recordings, columns, counts)
    counts.finish()
    values = dict[str, Any]()
    for name, dtype in COLUMNS.items():
        if name in columns:
            values[name] = columns.pop(name).astype(dtype, copy=False)
    for kind, names in ids.items():
        values[f"{kind}s"] = names
    values["channel_names"] = contents.channel_names
    values["notes"] = [asdict(note) for note in contents.notes]
    values["live"] = counts.low < counts.high
    write_columns(folder, values)
    return catalogue_of(contents.recordings, contents.unread)


def _check_spread(path: Path, counts: CountsFile) -> None:
    """Refuse readings that vary too little to be told apart in single precision."""
    spread = float((counts.high - counts.low).max())
    if 0 < spread < MIN_SPREAD:
        what = f"no sensor varies by more than {spread:.3g}; expected {MIN_SPREAD:g} or more"
        raise UserError(f"{path}: {what}: rescale the readings")


def _sort_lines(
    recordings: Sequence[Named], columns: dict[str, np.ndarray], counts: CountsFile
) -> None:
    """Sort the lines of each table by recording, since its recordings can be mixed."""
    done = set[int]()
    for recording in recordings:
        first = recording.found.first
        if isinstance(recording.lines, slice) or first in done:
            continue
        done.add(first)
        rows = slice(first, first + recording.found.frames)
        order = np.argsort(columns["recording"][rows], kind="stable")
        if (order == np.arange(len(order))).all():
            continue
        counts.sort(first, order)
        for values in columns.values():
            values[rows] = values[rows][order]
