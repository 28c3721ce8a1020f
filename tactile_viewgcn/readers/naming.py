"""Give recordings their names: from a catalogue, their file, a labels.csv, or their path."""

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
from tactile_viewgcn.readers.lines import runs_of, session_of_all_lines, unused_columns
from tactile_viewgcn.readers.source import (
    ATTRIBUTES_TOPIC,
    UNLABELLED,
    Form,
    Recording,
    columns_setting,
    label_text,
    side_of,
)

# the names of a recording in a catalogue
NAMES = ("object", "session", "recording", "take", "split")
NO_SESSION_NAMED = "session"  # the name of the session if a recording names none
AS_WINDOWS = "save X (n, frames, channels) and y (n,) by numpy.savez('all.npz', X=X, y=y)"


#: Reads frames (n, H, W), from the number of the first frame and the number of frames.
FramesReader = Callable[[int, int], np.ndarray]


@dataclass(frozen=True)
class Found:
    """A recording as its files have it, without its frames; or a table of recordings.

    Attributes:
        files: the file, or the files that were joined.
        parts: the part of the sensors in each file, such as ["left", "right"]. It is [""] if
            nothing names a part, and ["left"] if there is only a file for the left hand.
        recording: the names and notes that stand in the files. Its `values` has only the columns
            (T,).
        is_only_array: whether its file holds no other array or table. If an array (3, 20, 4, 4) is
            cut into three recordings, this is true for each of them.
        axes: the shape of the array in its file, from which frames were made.
        shape: (H, W) the shape of a frame.
        dtype: the type in which a table stores the pressure.
        first: the number of its first frame among all frames.
        frames: the number of its frames.
        is_written: whether its frames are in the file of counts. They are not if their shape
            differs from the first recording's. Nor are they if all frames so far take more room
            than may be unpacked.
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
        found: the recording or the table in its files; the table can hold other recordings too.
        names: `object`, `session` and `recording`; also `take` and `split` if there are any.
        place: which recording of its file it is.
        lines: the indices of its frames among all frames.
        notes: how its contents were read.
    """

    found: Found
    names: dict[str, str]
    place: str
    lines: slice | np.ndarray
    notes: list[Note] = field(default_factory=list)

    @property
    def frames(self) -> int:
        """The number of frames."""
        if isinstance(self.lines, slice):
            return int(self.lines.stop - self.lines.start)
        return len(self.lines)

    @property
    def is_split_by_frame(self) -> bool:
        """Whether the file has a published set for each frame, and nothing overrules it."""
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
    """Return the names of a recording, each from the first argument that has it.

    Args:
        given: the names in the catalogue that is the source. An empty cell means the default,
            whatever the file says.
        in_file: the names in attributes, in columns, and in arrays next to windows.
        labels: the names in a labels.csv.
        in_path: the names in the path of the file.
        default: the names to use if nothing else gives them.
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
    """A rule that gives the recordings in the files of a source their names.

    Args:
        source: the source.
        files: its files that hold recordings, in order.
        labels: the objects and sessions in a labels.csv, by the files' own names.
        form: the form in which the files are read.

    Attributes:
        files: see above.
        has_labels: whether there is a labels.csv.
        layout: the layout of the files' paths.
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
        """Return the object that a labels.csv or a path names; None if neither does."""
        if self._labels:
            return self._labels.get(file.stem, {}).get("object")
        names = names_in(self._source.place_of(file), self.layout)
        if not names:
            return None
        return names.get("object", None if self._form.labelled else "")

    def named(self, found: Found, read_frames: FramesReader) -> list[Named]:
        """Return the recordings in a recording or a table of this source, with their names.

        Args:
            found: the recording or the table.
            read_frames: reads the counts, for a hint if no object is named.

        Raises:
            UserError: nothing names the object, or the name of the published set is not known.
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
            default=self._default(found.file, recording.place)
            | session_of_all_lines(recording.labels),
        )
        names = self._checked(found, names)
        lines = slice(found.first, found.first + found.frames)
        notes = [*recording.notes, *guessed]
        if self._source.given is None:
            layout = "" if self.has_labels else self.layout
            notes += unused_columns(recording.labels, names, layout)
        return [Named(found, names, recording.place, lines, notes)]

    def _default(self, file: Path, place: str) -> dict[str, str]:
        name = self._source.place_of(file)
        if place:
            name = f"{name}/{place}"
        return {"recording": name, "object": UNLABELLED, "session": NO_SESSION_NAMED}

    def _names_in_path(
        self, found: Found, read_frames: FramesReader
    ) -> tuple[dict[str, str], list[Note]]:
        """Return the names in a file's path, and notes on the layout if it was guessed.

        The path must name the object if the file holds only one array or table and names no object
        itself.
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
        """Return whether the lines of a table name its recordings, and its place does not."""
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
        of_place = names_in(self._source.place_of(found.file), self.layout)
        in_path = {kind: name for kind, name in of_place.items() if kind in ("session", "split")}
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

        `by frame` stays as it is if the file has a published set for each frame.
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
            what = f"split is {split!r}, but the file has no published set for each frame"
            raise UserError(f"{found.file}: {what}; write train, test or validation")
        code = side_of(split)
        if code is None:
            raise UserError(f"{found.file}: split is {split!r}; expected train, test or validation")
        names["split"] = SIDES[code]
        return names


def hint_of(found: Found, read_frames: FramesReader) -> str:
    """Return a hint where a file can name its objects, if its path names none.

    Returns:
        The note on the attributes of an HDF5 file, if there is one. For a table or an array of two
        axes, the hint says that each line is read as one frame. It names a column that looks like
        labels, see `_label_like_column`, and says how to save lines that are whole recordings. For
        any other file, and if the frames are not written, it is "".
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
        text += f"; {what}: if these are the objects, {columns_setting(f'object:{key}')}"
    return f"{text}; if a line is a whole recording, {AS_WINDOWS}"


def _label_like_column(table: np.ndarray) -> int | None:
    """Return the number of the column of a table (T, S) that looks like labels, or None.

    Such a column holds only whole numbers, with at least two and at most T / 2 different values. If
    there are several, it is the column with the fewest different values.
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

    Two recordings are held out together if they have the same object and the same take. If a
    recording names no take, the stem of its name takes its place, see `stem_of`. A recording whose
    take is "" is held out with no other.
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
    """Return the catalogue of recordings.

    A recording that was joined has a row for each of its files.

    Args:
        recordings: the recordings with their names.
        unread: the mistake in each file that was not read, "" if only its ending is the reason.

    Returns:
        The columns `COLUMNS` of `readers.catalogue`, with rows for the recordings and a row for
        each file that was not read.
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
    # object texts, since those of pandas cannot hold every name of a file
    return pd.DataFrame(rows, columns=list(COLUMNS), dtype=object)


def _split_of(recording: Named) -> str:
    """Return the published set of a recording; `BY_FRAME` if its frames are in several sets."""
    if not recording.is_split_by_frame:
        return recording.names.get("split", "")
    found = recording.found
    codes = np.unique(found.recording.values["split"])
    return SIDES[int(codes[0])] if len(codes) == 1 else BY_FRAME
