"""How recordings get their names: from a catalogue, their file, a labels.csv, or their path."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError
from tactile_viewgcn.params import SIDES
from tactile_viewgcn.readers.catalogue import BY_FRAME, COLUMNS
from tactile_viewgcn.readers.discovery import Source
from tactile_viewgcn.readers.formats import ARRAYS, TEXTS, has_ending
from tactile_viewgcn.readers.layout import layout_of, names_in, names_of, raw_names, stem_of
from tactile_viewgcn.readers.lines import runs_of
from tactile_viewgcn.readers.source import (
    ATTRIBUTES_TOPIC,
    UNLABELLED,
    Form,
    Recording,
    label_text,
    setting,
    side_of,
)

NAMES = ("object", "session", "recording", "take", "split")  # of a recording, in a catalogue
NO_SESSION_NAMED = "session"  # name of the session of recordings that name none
AS_WINDOWS = "save X (n, frames, channels) and y (n,) by numpy.savez('all.npz', X=X, y=y)"


#: Reads frames (n, H, W) by the number of the first one, and how many.
FramesReader = Callable[[int, int], np.ndarray]


@dataclass(frozen=True)
class Found:
    """A recording as it was found in its files, without its frames; or a table of recordings.

    Attributes:
        files: mostly one; several where files were joined.
        parts: the part of the sensors in each file, such as ["left", "right"]. It is [""] where
            nothing names a part, and ["left"] where there is a file for the left hand only.
        recording: names and notes that stand in the files; `values` has the columns (T,) only.
        is_only_array: its file holds no other array or table. An array (3, 20, 4, 4) is cut into
            three recordings, and each of them is of the only array.
        axes: of the array in its file, of which frames were made.
        shape: (H, W) of a frame.
        dtype: in which a table stores the pressure.
        first: number of its first frame among all frames.
        frames: their number.
        is_written: its frames are in the file of counts. They are not if their shape differs from
            the first recording's, or if all frames so far take more room than may be unpacked.
    """

    files: list[Path]
    parts: list[str]
    recording: Recording
    is_only_array: bool
    axes: tuple[int, ...]
    shape: tuple[int, int]
    dtype: np.dtype
    first: int
    frames: int
    is_written: bool

    @property
    def file(self) -> Path:
        """The first file."""
        return self.files[0]


@dataclass(frozen=True)
class Named:
    """A recording with its names.

    Attributes:
        found: where it was found; its frames may be among others.
        names: `object`, `session`, `recording`, and as far as there are any `take` and `split`.
        place: which recording of its file it is.
        lines: indices among all frames, of its frames.
        notes: what was taken for what.
    """

    found: Found
    names: dict[str, str]
    place: str
    lines: slice | np.ndarray
    notes: list[Note] = field(default_factory=list)

    @property
    def frames(self) -> int:
        """Number of frames."""
        if isinstance(self.lines, slice):
            return int(self.lines.stop - self.lines.start)
        return len(self.lines)

    @property
    def is_split_by_frame(self) -> bool:
        """Whether the file has a published set for each frame, and nothing says another."""
        said = self.names.get("split", BY_FRAME)
        return "split" in self.found.recording.values and said == BY_FRAME

    @property
    def has_split(self) -> bool:
        """Whether its frames have a published set."""
        return self.is_split_by_frame or self.names.get("split", "") in SIDES


def chosen_names(
    *,
    given: Mapping[str, str] | None,
    in_file: Mapping[str, str],
    labels: Mapping[str, str],
    in_path: Mapping[str, str],
    default: Mapping[str, str],
) -> dict[str, str]:
    """Return the names of a recording, each from the first of these that has it.

    Args:
        given: by the catalogue that is the source; an empty cell means the default, whatever the
            file says.
        in_file: attributes, columns, and what stands beside windows.
        labels: of a labels.csv.
        in_path: of the layout of folders and file names.
        default: where nothing says it.
    """
    names = dict(default)
    for said in (in_path, labels, in_file):
        names |= {kind: name for kind, name in said.items() if name}
    if given is None:
        return names
    for kind, name in given.items():
        names[kind] = name or default.get(kind, "")
    return names


class Naming:
    """Gives names to what was found in the files of a source.

    Args:
        source: its files.
        files: that hold recordings, in order.
        labels: objects and sessions by the files' own names, of a labels.csv.
        form: as which the files are read.

    Attributes:
        files: see above.
        has_labels: there is a labels.csv.
        layout: of the files' paths.
    """

    def __init__(
        self,
        source: Source,
        files: Sequence[Path],
        labels: Mapping[str, Mapping[str, str]],
        form: Form,
    ):
        self._source = source
        self.files = files
        self.has_labels = bool(labels)
        self._labels = labels
        self._form = form
        self._given = dict[tuple[Path, str], dict[str, str]]()
        self.layout = ""
        self._guessed = list[Note]()
        if source.given is not None:
            kinds = [kind for kind in NAMES if kind in source.given]
            for row in source.given.to_dict("records"):
                self._given[row["path"], row["place"]] = {kind: row[kind] for kind in kinds}
        elif not source.is_raw:
            places = [source.place_of(file) for file in files]
            self.layout, self._guessed = layout_of(places, form)

    def object_of(self, file: Path) -> str | None:
        """Return the object that a labels.csv or a path names; None where neither does."""
        if self._labels:
            return self._labels.get(file.stem, {}).get("object")
        names = names_in(self._source.place_of(file), self.layout)
        if not names:
            return None
        return names.get("object", None if self._form.labelled else "")

    def named(self, found: Found, read_frames: FramesReader) -> list[Named]:
        """Return the recordings in what was found, with their names.

        Args:
            found: of this source.
            read_frames: reads the counts, for a hint where no object is named.

        Raises:
            UserError: nothing names the object, or the published set is called otherwise.
        """
        if self._is_table_of_recordings(found):
            return self._named_lines(found, read_frames)
        recording = found.recording
        in_path, guessed = self._names_in_path(found, read_frames)
        names = chosen_names(
            given=self._given.get((found.file, recording.place)),
            in_file=recording.names,
            labels=self._labels.get(found.file.stem, {}),
            in_path=in_path,
            default=self._default(found.file, recording.place),
        )
        lines = slice(found.first, found.first + found.frames)
        notes = [*recording.notes, *guessed]
        return [Named(found, self._checked(found, names), recording.place, lines, notes)]

    def _default(self, file: Path, place: str) -> dict[str, str]:
        name = self._source.place_of(file)
        if place:
            name = f"{name}/{place}"
        return {"recording": name, "object": UNLABELLED, "session": NO_SESSION_NAMED}

    def _names_in_path(
        self, found: Found, read_frames: FramesReader
    ) -> tuple[dict[str, str], list[Note]]:
        """Return the names in a file's path, and notes on the layout if it was guessed.

        They are asked for where the file holds one array or table and names no object.
        """
        file = found.file
        if self._source.given is not None:
            return {}, []
        if self._source.is_raw:
            return raw_names(file), []
        said = {**self._labels.get(file.stem, {}), **found.recording.names}
        needs_names = self._form.labelled or has_ending(file, [*TEXTS, *ARRAYS])
        if found.is_only_array and needs_names and not said.get("object"):
            hint = partial(hint_of, found, read_frames)
            place = self._source.place_of(file)
            return names_of(file, place, self.layout, self._form, hint), self._guessed
        names = names_in(self._source.place_of(file), self.layout)
        return {kind: name for kind, name in names.items() if kind == "recording"}, []

    def _is_table_of_recordings(self, found: Found) -> bool:
        """Return whether the lines of a table name its recordings, and not its place."""
        if self._source.given is not None or not has_ending(found.file, TEXTS):
            return False
        has_object = "object" in found.recording.labels
        if len(self.files) == 1:
            return has_object or not self._form.labelled
        return has_object and not self.object_of(found.file)

    def _named_lines(self, found: Found, read_frames: FramesReader) -> list[Named]:
        """Return the recordings in the lines of a table, see `runs_of`."""
        labels = found.recording.labels
        prefix = self._source.place_of(found.file)
        if len(self.files) == 1 and "object" in labels:
            prefix = ""
        time = found.recording.values.get("time")
        runs, notes = runs_of(labels, time, found.frames, prefix)
        in_path = dict[str, str]()
        guessed = list[Note]()
        if len(runs) == 1 and "object" not in labels:
            in_path, guessed = self._names_in_path(found, read_frames)
        recordings = list[Named]()
        for run in runs:
            names = chosen_names(
                given=None,
                in_file=run.names,
                labels=self._labels.get(found.file.stem, {}),
                in_path=in_path,
                default=self._default(found.file, ""),
            )
            lines = found.first + run.lines
            run_notes = [*found.recording.notes, *notes, *guessed]
            names = self._checked(found, names)
            recordings.append(Named(found, names, run.place, lines, run_notes))
        return recordings

    def _checked(self, found: Found, names: dict[str, str]) -> dict[str, str]:
        """Return the names with tidy objects and sessions, and `split` as one of `SIDES`.

        `by frame` stays as it is where the file has a published set for each frame.
        """
        names = dict(names)
        for kind in ("object", "session"):
            names[kind] = label_text(names[kind])
        split = names.get("split", "")
        if not split:
            return names
        if split == BY_FRAME:
            if "split" in found.recording.values:
                return names
            what = f"split is {split!r}, and the file has no published set of each frame"
            raise UserError(f"{found.file}: {what}; write train, test or validation")
        code = side_of(split)
        if code is None:
            raise UserError(f"{found.file}: split is {split!r}; expected train, test or validation")
        names["split"] = SIDES[code]
        return names


def hint_of(found: Found, read_frames: FramesReader) -> str:
    """Return where the objects that no path names may stand instead, and what to type.

    Returns:
        The note on the attributes of an HDF5 file, if there is one. Of a table, or an array of two
        axes: that each line is read as one frame, which column may hold the objects, if one looks
        like labels (see `_label_like_column`), and what to type if a line is a whole recording. Of
        all other files, and where the frames are not written: "".
    """
    recording = found.recording
    attributes = [note.text for note in recording.notes if note.topic == ATTRIBUTES_TOPIC]
    if attributes:
        return attributes[0]
    if len(found.axes) != 2 or not found.frames or not found.is_written:
        return ""
    readings = read_frames(found.first, found.frames)
    table = readings.astype(np.float64).reshape(found.frames, -1)
    names = recording.channel_names or [""] * table.shape[1]
    best = _label_like_column(table)
    text = "each line is read as one frame"
    if best is not None:
        key = names[best] or str(best + 1)
        what = f"column {key!r} holds {len(np.unique(table[:, best]))} whole numbers"
        text += f"; {what}: if these are the objects, {setting(f'data.columns=[object:{key}]')}"
    return f"{text}; if a line is a whole recording, {AS_WINDOWS}"


def _label_like_column(table: np.ndarray) -> int | None:
    """Return the number of the column of a table (T, S) that may hold labels, or None.

    It holds whole numbers, at least two different ones and at most T / 2. Of several such columns
    it is the one with the fewest different numbers.
    """
    fewest = dict[int, int]()
    for number, column in enumerate(table.T):
        count = len(np.unique(column))
        if 2 <= count <= len(column) / 2 and not (column % 1).any():
            fewest[number] = count
    if not fewest:
        return None
    return min(fewest, key=lambda number: fewest[number])


def ids_of(recordings: Sequence[Named]) -> dict[str, list[str]]:
    """Return the names of objects, recordings and sessions in the order of their numbers.

    The empty hand comes first, and recordings are in the order of their files.
    """
    objects = {recording.names["object"] for recording in recordings}
    sessions = {recording.names["session"] for recording in recordings}
    return {
        "object": sorted(objects, key=lambda name: (name != EMPTY_HAND, name)),
        "recording": [recording.names["recording"] for recording in recordings],
        "session": sorted(sessions),
    }


def takes_of(recordings: Sequence[Named]) -> np.ndarray:
    """Return for each recording (R,) the number of the first one that is held out together with it.

    These have one object, and one take by their names or else one name without hand, axis, device,
    part or copy, see `stem_of`. A take of "" is the recording's own.
    """
    keys = list[tuple[str, str]]()
    for number, recording in enumerate(recordings):
        names = recording.names
        if "take" not in names:
            keys.append((names["object"], stem_of(names["recording"])))
        elif names["take"]:
            keys.append((names["object"], names["take"]))
        else:
            keys.append((names["object"], f"\0{number}"))
    first = dict[tuple[str, str], int]()
    return np.array([first.setdefault(key, number) for number, key in enumerate(keys)], dtype=int)


def catalogue_of(recordings: Sequence[Named], unread: Mapping[Path, str]) -> pd.DataFrame:
    """Return the catalogue of recordings, of which those that were joined have a row for each file.

    Args:
        recordings: with their names.
        unread: what is wrong in each file that was not read, "" where its ending says it.

    Returns:
        The columns `COLUMNS` of `readers.catalogue`, a row for each recording and each other file.
    """
    takes = takes_of(recordings)
    counts = np.bincount(takes, minlength=len(recordings))
    rows = list[dict[str, object]]()
    for number, recording in enumerate(recordings):
        names = recording.names
        take = ""
        if counts[takes[number]] > 1:
            take = recordings[takes[number]].names["recording"]
        for file, part in zip(recording.found.files, recording.found.parts, strict=True):
            row: dict[str, object] = {
                **dict.fromkeys(COLUMNS, ""),
                "file": str(file),
                "place": recording.place,
                "part": part if len(recording.found.files) > 1 else "",
                "take": take,
                "split": _split_of(recording),
                "frames": recording.frames,
            }
            for kind in ("object", "session", "recording"):
                row[kind] = names[kind]
            rows.append(row)
    for file, reason in unread.items():
        left_out = reason or f"no recording by its ending {file.suffix}".strip()
        left = {**dict.fromkeys(COLUMNS, ""), "file": str(file), "frames": 0}
        rows.append(left | {"left_out": left_out})
    # texts of pandas cannot hold every name of a file
    return pd.DataFrame(rows, columns=list(COLUMNS), dtype=object)


def _split_of(recording: Named) -> str:
    """Return the published set of a recording; `BY_FRAME` where its frames are of several."""
    if not recording.is_split_by_frame:
        return recording.names.get("split", "")
    found = recording.found
    codes = np.unique(found.recording.values["split"])
    return SIDES[int(codes[0])] if len(codes) == 1 else BY_FRAME
