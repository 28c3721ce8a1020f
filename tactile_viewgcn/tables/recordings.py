"""Define the table of raw counts, data/recordings: every frame of every recording of a source.

`read_source` reads the files, checks them and writes a folder, which `Recordings` reads. Counts are
the sensors' raw ADC counts, or readings in the glove's unit. Their axes are (frame, row, column).
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from tactile_viewgcn.files import new_files, readable, write_file
from tactile_viewgcn.messages import EMPTY_HAND, Note
from tactile_viewgcn.readers.catalogue import catalogue_text
from tactile_viewgcn.readers.child import limit, run_apart, serve, system_limits
from tactile_viewgcn.readers.discovery import bytes_of, discover, files_of
from tactile_viewgcn.readers.source import (
    AUTO,
    BLOCK_FRAMES,
    COLUMNS,
    MODEL_TOPIC,
    Form,
    Recording,
)
from tactile_viewgcn.tables.counts import Counts, Gathered, part_of, read_columns, read_counts
from tactile_viewgcn.tables.reading import write_recordings

ALWAYS = tuple(COLUMNS)[:5]  # the columns that every table has
NO_SESSION = ""  # the name of the session if a recording names none
CATALOGUE = "catalogue.csv"  # the file that the child writes into the table's folder, if asked to


def read_source(path: Path, out: Path, form: Form = AUTO, *, catalogue: Path | None = None) -> None:
    """Write the recordings at a path to a table, in a child process, see `run_apart`.

    If anything fails, no file is left behind.

    Args:
        path: the path of the source, see `discover`.
        out: the folder of the table.
        form: the form in which files are read.
        catalogue: a file to which the catalogue of the recordings is written too.

    Raises:
        UserError: the child crashed. `discover` and `write_recordings` raise it too.
    """
    with new_files(out) as part:
        request = {"path": str(path), "out": str(part), "form": asdict(form)}
        if catalogue is not None:
            request["catalogue"] = str(catalogue.parent.absolute())
        run_apart("tactile_viewgcn.tables.recordings", request, path)
        if catalogue is not None:
            text = (part / CATALOGUE).read_text("utf-8")
            (part / CATALOGUE).unlink()
            write_file(catalogue, text)


def _read_here(request: dict[str, Any]) -> None:
    """Write the table that `read_source` requests; the child process calls this."""
    path = Path(request["path"])
    form = Form(**request["form"])
    # Arrow's texts need more memory than this process is allowed
    pd.set_option("mode.string_storage", "python")
    system = system_limits()
    limit(request, bytes_of(files_of(path)), system)
    source = discover(path, form)
    if source.given is not None:
        limit(request, bytes_of(source.files), system)
    folder = Path(request["out"])
    rows = write_recordings(folder, source, form)
    if "catalogue" in request:
        text = catalogue_text(rows, Path(request["catalogue"]))
        (folder / CATALOGUE).write_text(text, encoding="utf-8", newline="")


@contextmanager
def recordings_of(
    path: str | Path, form: Form = AUTO, *, catalogue: Path | None = None
) -> Iterator["Recordings"]:
    """Yield a temporary table of the recordings at a path; its errors name that path.

    Args:
        path: the path of the source.
        form: the form in which files are read.
        catalogue: a file to which the catalogue of the recordings is written too.
    """
    with TemporaryDirectory(prefix="tactile-viewgcn-") as folder:
        file = Path(folder) / "recordings"
        read_source(Path(path), file, form, catalogue=catalogue)
        yield replace(Recordings.read(file), path=Path(path))


@dataclass(eq=False)
class Recordings:
    """The table of raw counts, which are read when they are indexed.

    Its columns are arrays and not a DataFrame: they are compared position by position, whereas
    pandas would align them by label. To group columns, make a DataFrame of them.

    Attributes:
        path: the path of the table or of its source, which errors name.
        objects: the names of the objects, by the column `object`.
        recordings: the names of the recordings, by the column `recording`.
        sessions: the names of the sessions, by the column `session`.
        counts: (T, H, W), the counts of all frames.
        columns: an array (T,) for each column of the source, see `COLUMNS`.
        live: bool (H, W), the sensors whose counts vary.
        channel_names: the names of all sensors, row after row, or none.
        notes: the notes of the reader, see `source_notes`.
    """

    path: Path
    objects: list[str]
    recordings: list[str]
    sessions: list[str]
    counts: Counts
    columns: dict[str, np.ndarray]
    live: np.ndarray
    channel_names: list[str]
    notes: list[Note]

    @classmethod
    def read(cls, path: str | Path) -> "Recordings":
        """Return the table at a path.

        Raises:
            UserError: the table is damaged, or another version of the project wrote it.
        """
        folder = Path(path)
        with readable(folder):
            values = read_columns(folder)
            columns = {
                name: values.pop(name) for name in COLUMNS if name in values or name in ALWAYS
            }
            notes = [Note(**note) for note in values.pop("notes")]
            return cls(folder, counts=read_counts(folder), columns=columns, notes=notes, **values)

    def __len__(self) -> int:
        return len(self.counts)

    @property
    def shape(self) -> tuple[int, int]:
        """Return the shape (H, W) of a frame."""
        height, width = self.live.shape
        return height, width

    @property
    def empty_hand(self) -> np.ndarray:
        """Return the frames of recordings of the empty hand, bool (T,)."""
        if EMPTY_HAND not in self.objects:
            return np.zeros(len(self), dtype=bool)
        is_empty: np.ndarray = self.columns["object"] == self.objects.index(EMPTY_HAND)
        return is_empty

    def sensor_names(self, chosen: np.ndarray) -> list[str]:
        """Return the names of sensors: their channels, or else their rows and columns from 1.

        Args:
            chosen: bool (H, W), the sensors.
        """
        if self.channel_names:
            return [self.channel_names[index] for index in np.flatnonzero(chosen)]
        if len(chosen) == 1:
            return [f"column {number}" for number in self.sensor_numbers[chosen[0]]]
        return [f"row {row}, column {column}" for row, column in np.argwhere(chosen) + 1]

    @property
    def sensor_numbers(self) -> np.ndarray:
        """Return the numbers (W,), from 1, of the sensors of one row in their file's columns."""
        topics = ("columns", MODEL_TOPIC)
        values = [note.value for note in self.notes if note.topic in topics]
        others = [value for value in values if isinstance(value, int)]
        numbers = np.arange(1, self.live.size + len(others) + 1)
        return np.setdiff1d(numbers, others)[: self.live.size]

    def part(self, rows: np.ndarray) -> "Recordings":
        """Return the frames in rising `rows` (n,) as a table with the same live sensors."""
        counts = self.counts
        if len(rows) < len(self):
            counts = part_of(counts, rows)
        columns = {name: values[rows] for name, values in self.columns.items()}
        return replace(self, counts=counts, columns=columns)

    def varying(self, rows: np.ndarray) -> np.ndarray:
        """Return the live sensors whose counts vary in some frames, bool (H, W).

        Args:
            rows: the rising indices (n,) of at least one frame.
        """
        part = self.part(rows)
        first = part.counts[np.zeros(1, dtype=int)]
        varying = np.zeros(self.shape, dtype=bool)
        for _, counts in part.blocks():
            varying |= (counts != first).any(axis=0)
        return self.live & varying

    def live_counts(self) -> Gathered:
        """Return the counts (T, S) of the live sensors, read when they are indexed."""
        return Gathered(self._counts_of_live_sensors, np.arange(len(self)))

    def _counts_of_live_sensors(self, rows: np.ndarray) -> np.ndarray:
        counts = self.counts[rows].reshape(len(rows), self.live.size)
        return counts.take(np.flatnonzero(self.live), axis=1)

    def blocks(self) -> Iterator[tuple[int, np.ndarray]]:
        """Yield all frames in order, as pairs of the first frame's index and counts (n, H, W)."""
        for start in range(0, len(self), BLOCK_FRAMES):
            yield start, self.counts[start : start + BLOCK_FRAMES]


def in_memory(
    recordings: Sequence[Recording],
    objects: list[str],
    labels: np.ndarray,
    sessions: np.ndarray,
    session_names: Sequence[str],
) -> Recordings:
    """Return the table of n recordings with the same sensors, and the times of those that have any.

    Args:
        recordings: the recordings, from `recording_of`.
        objects: the names of the objects.
        labels: (n,) the index of each recording's object.
        sessions: (n,) the index of each recording's session.
        session_names: the names of the sessions. New recordings are of sessions that are called
            `NO_SESSION`.
    """
    arrays = [recording.values["pressure"] for recording in recordings]
    lengths = [len(array) for array in arrays]
    counts = np.concatenate(arrays)
    row = np.repeat(np.arange(len(arrays)), lengths)
    clocks = [
        recording.values.get("time", np.full(length, np.nan))
        for recording, length in zip(recordings, lengths, strict=True)
    ]
    columns = {
        "object": labels[row],
        "recording": row,
        "session": sessions[row],
        "time": np.concatenate([clock - clock[:1] for clock in clocks]),
        "frame": np.concatenate([np.arange(length) for length in lengths]),
    }
    return Recordings(
        path=Path("X"),
        objects=objects,
        recordings=[recording.names["recording"] for recording in recordings],
        sessions=list(session_names),
        counts=counts,
        columns=columns,
        live=(counts != counts[0]).any(axis=0),
        channel_names=recordings[0].channel_names,
        notes=recordings[0].notes,
    )


def frames_by_recording(recordings: Recordings) -> list[np.ndarray]:
    """Return the indices of the frames of each recording that has frames."""
    recording = recordings.columns["recording"]
    order = np.argsort(recording, kind="stable")
    return np.split(order, 1 + np.flatnonzero(np.diff(recording[order])))


if __name__ == "__main__":
    serve(_read_here)
