"""The table of raw counts, data/recordings.h5: every frame of every recording, whatever form it was read from.

A reader describes recordings as a `Source`, whose frames come in blocks. `write_recordings` checks them and writes
one HDF5 file, which `Recordings` reads. Counts are the sensors' raw ADC counts, or in whatever unit the glove reads;
axes are (frame, row, column).
"""

from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
from tqdm import tqdm

from tactile_viewgcn.files import atomic_write, readable
from tactile_viewgcn.readers.source import BLOCK_FRAMES, COLUMNS, Block, Source, checked_blocks
from tactile_viewgcn.tables.stored import Counts, StoredCounts, held

SOURCE_MD5 = "source_md5"  # attribute that only the table has: md5 of the source


def write_recordings(path: str | Path, source: Source, md5: str) -> None:
    """Write the frames of a source, whose md5 is given, to one HDF5 table, block by block.

    Raises:
        UserError: no frames, an id out of range, or pressure that is not finite or too large; no file is left behind.
    """
    low = np.full(source.shape, np.inf)
    high = np.full(source.shape, -np.inf)
    total = 0
    bar = tqdm(desc="ingest", unit="frame", unit_scale=True, disable=None)
    with atomic_write(path) as part, h5py.File(part, "w") as file, bar:
        pressure = file.create_dataset(
            "pressure",
            (0, *source.shape),
            source.dtype,
            maxshape=(None, *source.shape),
            chunks=(64, *source.shape),
            compression="gzip",
            compression_opts=1,
            shuffle=True,
        )
        for block in checked_blocks(source):
            counts = block["pressure"]
            low = np.minimum(low, counts.min(axis=0))
            high = np.maximum(high, counts.max(axis=0))
            total += len(counts)
            pressure.resize(total, axis=0)
            pressure[-len(counts) :] = counts
            _append_columns(file, block, len(counts), total)
            bar.update(len(counts))
        file["live"] = low < high
        names = {"objects": source.objects, "recordings": source.recordings, "sessions": source.sessions}
        for name, values in names.items():
            file[name] = np.array(values, dtype=h5py.string_dtype())
        if source.weights is not None:
            file["weights"] = np.asarray(source.weights, dtype=np.float64)
        if source.action is not None:
            file["action"] = np.asarray(source.action, dtype=np.float64)
        file.attrs[SOURCE_MD5] = md5


def is_table(path: Path) -> bool:
    """Whether a file was written by `write_recordings`."""
    try:
        with h5py.File(path, "r") as file:
            return SOURCE_MD5 in file.attrs
    except OSError:  # no HDF5 file, or cut short
        return False


def read_table(path: Path) -> Source:
    """The source that a table was written from.

    Raises:
        UserError: damaged, or of another version.
    """
    with Recordings(path) as table:
        shape, dtype = table.shape, table.dtype

    def blocks() -> Iterator[Block]:
        with Recordings(path) as table:
            for start, counts in table.blocks():
                at = slice(start, start + len(counts))
                yield {"pressure": counts, **{name: values[at] for name, values in table.columns.items()}}

    names = table.objects, table.recordings, table.sessions
    return Source(path, *names, shape, dtype, blocks(), weights=table.weights, action=table.action)


def _append_columns(file: h5py.File, block: Block, count: int, total: int) -> None:
    """Append the columns (count,) of a block to the file's, which then have `total` values."""
    for name, dtype in COLUMNS.items():
        if name not in block:
            continue
        if name not in file:
            file.create_dataset(name, (0,), dtype, maxshape=(None,), chunks=(BLOCK_FRAMES,))
        file[name].resize(total, axis=0)
        file[name][-count:] = block[name].astype(dtype)


class Recordings:
    """The table of raw counts, open for reading; a context that closes it. Frames are read when asked for.

    Attributes:
        path: of the file.
        objects, recordings, sessions: names, by index.
        columns: one array (T,) for each column that the source has, see `COLUMNS`.
        live: bool (H, W), the sensors whose counts vary.
        weights: (objects,) grams, or None.
        action: (recordings, 2) seconds from and to which the object is handled, or None.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        with readable(path):
            self._file = h5py.File(path, "r")
            self.objects, self.recordings, self.sessions = (
                [text.decode() for text in self._file[name][()]] for name in ("objects", "recordings", "sessions")
            )
            self.columns = {name: self._file[name][()] for name in COLUMNS if name in self._file}
            self.live = self._file["live"][()]
            self.weights, self.action = (
                self._file[name][()] if name in self._file else None for name in ("weights", "action")
            )
            self._pressure: Counts = StoredCounts(self.path, self._file["pressure"])

    def __enter__(self) -> "Recordings":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __len__(self) -> int:
        return len(self._pressure)

    @property
    def dtype(self) -> np.dtype:
        """Type of the counts."""
        return self._pressure.dtype

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W) of a frame."""
        height, width = self.live.shape
        return height, width

    def frames(self, index: np.ndarray) -> np.ndarray:
        """Counts (n, H, W) of the frames in an index (n,)."""
        return self._pressure[index]

    def kept_counts(self, index: np.ndarray) -> Counts:
        """The same, but read when they are indexed where they take too much of the free memory.

        They can be read when the table is closed.
        """
        return held(StoredCounts(self.path, h5py.File(self.path, "r")["pressure"], rows=index))

    def live_counts(self) -> Counts:
        """Counts (T, S) of the live sensors; see `kept_counts`."""
        return held(StoredCounts(self.path, h5py.File(self.path, "r")["pressure"], sensors=self.live))

    def blocks(self) -> Iterator[tuple[int, np.ndarray]]:
        """All frames in order, as pairs of the number of the first frame and counts (n, H, W)."""
        for start in range(0, len(self), BLOCK_FRAMES):
            yield start, self._pressure[start : start + BLOCK_FRAMES]
