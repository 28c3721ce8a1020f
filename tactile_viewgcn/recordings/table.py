"""The table of raw counts: every frame of every recording, whatever it was read from.

A reader (`stag.py`, `own_format.py`) describes a source as a `Source` and yields its frames in blocks;
`write_recordings` checks them and writes one HDF5 file; `Recordings` reads it back. Counts are the sensor's
raw ADC counts (or whatever unit the user's glove has), axes are (frame, row, column).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from tqdm import tqdm

from tactile_viewgcn.files import readable, whole

EMPTY_HAND = "empty_hand"  # the class that holds nothing, by STAG's name for it
TRAIN, TEST = 0, 1  # codes of the published split
MAX_SIDE = 64
BLOCK = 4096  # frames read or written at once
MARK = "source_md5"  # attribute of the table: what it was read from
LARGEST = 1e30  # pressure, in size: network input is of single precision
LISTED = 10  # mistakes told in one sentence

#: One value per frame. The first five are always there; the others where the source has them.
COLUMNS = {
    "object": np.int16,  # index into objects
    "recording": np.int16,  # index into recordings
    "session": np.int16,  # index into sessions
    "frame": np.int32,  # frame number inside the recording
    "time": np.float64,  # seconds since the recording's first frame
    "split": np.int8,  # published side: TRAIN or TEST
    "valid": np.bool_,  # the object is held (STAG: hasValidLabel)
    "balanced": np.bool_,  # STAG's subset of equally many frames a class (isBalanced)
    "transition": np.bool_,  # last empty frame before contact (isTransition)
    "grip": np.bool_,  # reliable contact (isGrap)
    "grasp": np.int16,  # number of the grasp inside the recording (graspIndex)
    "grasp_valid": np.bool_,  # 4th to 6th second of a grasp (graspValid)
}
ALWAYS = ("object", "recording", "session", "frame", "time")


@dataclass(frozen=True)
class Source:
    """What a reader found, and how to get its frames."""

    path: Path
    objects: list[str]
    recordings: list[str]
    sessions: list[str]
    shape: tuple[int, int]
    dtype: np.dtype
    blocks: Iterator[dict[str, np.ndarray]]  # "pressure" (n, H, W) and columns (n,), in the file's order
    weights: np.ndarray | None = None  # (objects,) grams, NaN where unknown
    action: np.ndarray | None = None  # (recordings, 2) seconds from and to which it is handled, -1: never


def storage_type(dtype: np.dtype, where: str) -> np.dtype:
    """int16 for counts that fit it, else int32; float32 for real numbers, float64 for those of double precision.

    Raises:
        ValueError: anything else.
    """
    if dtype.kind in "iu":
        return np.dtype(np.int16 if dtype.itemsize < 2 or dtype == np.int16 else np.int32)
    if dtype.kind == "f":
        return np.dtype(np.float32 if dtype.itemsize <= 4 else np.float64)
    raise ValueError(f"{where}: pressure is of type {dtype}; expected integer counts or real numbers")


def check_shape(shape: tuple[int, ...], where: str) -> tuple[int, int]:
    """(H, W) of a pressure array of shape (T, H, W); ValueError where it is none or too large."""
    if len(shape) != 3:
        raise ValueError(f"{where}: pressure has shape {shape}; expected (frames, rows, columns)")
    if not all(1 <= side <= MAX_SIDE for side in shape[1:]):
        raise ValueError(f"{where}: frames of {shape[1]} x {shape[2]}; expected 1 x 1 to {MAX_SIDE} x {MAX_SIDE}")
    return shape[1], shape[2]


def refuse(mistakes: list[str]) -> None:
    """ValueError that lists what is wrong with a source's files, the first ten in full; nothing where all is well."""
    if mistakes:
        more = [f"and {len(mistakes) - LISTED} more"] if len(mistakes) > LISTED else []
        raise ValueError("; ".join(mistakes[:LISTED] + more))


def write_recordings(path: str | Path, source: Source, md5: str) -> None:
    """Write a source's frames to one HDF5 table, block by block.

    Raises:
        ValueError: no frames, an id out of range, or pressure that is not finite or too large; nothing is left behind.
    """
    low = np.full(source.shape, np.inf)
    high = np.full(source.shape, -np.inf)
    total = 0
    bar = tqdm(desc="ingest", unit="frame", unit_scale=True, disable=None)
    with whole(path) as part, h5py.File(part, "w") as file, bar:
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
        for block in checked(source):
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
        file.attrs[MARK] = md5


def is_table(path: Path) -> bool:
    """Whether a file is such a table, by the mark that `write_recordings` leaves."""
    try:
        with h5py.File(path, "r") as file:
            return MARK in file.attrs
    except OSError:  # no HDF5 file, or cut short
        return False


def read_table(path: Path) -> Source:
    """A table as the source that it was written from.

    Raises:
        ValueError: damaged, or of another version.
    """
    with Recordings(path) as table:
        shape, dtype = table.shape, table.dtype

    def blocks() -> Iterator[dict[str, np.ndarray]]:
        with Recordings(path) as table:
            for start, counts in table.blocks():
                at = slice(start, start + len(counts))
                yield {"pressure": counts, **{name: values[at] for name, values in table.columns.items()}}

    names = table.objects, table.recordings, table.sessions
    return Source(path, *names, shape, dtype, blocks(), weights=table.weights, action=table.action)


def checked(source: Source) -> Iterator[dict[str, np.ndarray]]:
    """The source's blocks that hold frames, each checked.

    Raises:
        ValueError: no frames, a damaged file, an id out of range, or pressure that cannot be stored.
    """
    total = 0
    try:
        for block in source.blocks:
            if len(block["pressure"]):
                _check_block(block, source, total)
                total += len(block["pressure"])
                yield block
    except OSError as error:
        raise ValueError(f"{source.path}: damaged or cut short ({error}); download or record it again") from None
    if not total:
        raise ValueError(f"{source.path}: no frames; expected at least one recording with frames in it")


def _check_block(block: dict[str, np.ndarray], source: Source, start: int) -> None:
    counts, path = block["pressure"], source.path
    if source.dtype.kind == "i" and not np.can_cast(counts.dtype, source.dtype):
        limits = np.iinfo(source.dtype)
        if counts.min() < limits.min or counts.max() > limits.max:
            raise ValueError(
                f"{path}: pressure from {counts.min()} to {counts.max()}; "
                f"expected counts from {limits.min} to {limits.max}"
            )
    for column, among in (("object", "objects"), ("recording", "recordings"), ("session", "sessions")):
        count = len(getattr(source, among))
        _check_range(block[column], f"{column} id", (0, count - 1), f"({count} {among})", path, start)
    for column, kind in COLUMNS.items():
        if column in block and kind is not np.float64:
            low, high = (0, 1) if kind is np.bool_ else (np.iinfo(kind).min, np.iinfo(kind).max)
            _check_range(block[column], column, (low, high), "in whole numbers", path, start)
    if counts.dtype.kind == "f" and not (inside := np.abs(counts) <= LARGEST).all():
        bad = int(inside.all(axis=(1, 2)).argmin())
        found, recording = counts[bad][~inside[bad]][0], source.recordings[int(block["recording"][bad])]
        raise ValueError(
            f"{path}: pressure of frame {block['frame'][bad]} of recording {recording} is {found:g}; expected a number "
            f"from every sensor, up to {LARGEST:g}"
        )


def _check_range(values: np.ndarray, what: str, limits: tuple[int, int], remark: str, path: Path, start: int) -> None:
    inside = (values >= limits[0]) & (values <= limits[1]) & (values == np.floor(values))
    if not inside.all():
        at = int(inside.argmin())
        raise ValueError(
            f"{path}: {what} {values[at]} of frame {start + at} is out of range; "
            f"expected {limits[0]} to {limits[1]} {remark}"
        )


def _append_columns(file: h5py.File, block: dict[str, np.ndarray], count: int, total: int) -> None:
    for name, dtype in COLUMNS.items():
        if name not in block:
            continue
        if name not in file:
            file.create_dataset(name, (0,), dtype, maxshape=(None,), chunks=(BLOCK,))
        file[name].resize(total, axis=0)
        file[name][-count:] = block[name].astype(dtype)


class Recordings:
    """The table, its columns in memory, its frames read on demand. Close it, or use it as a context.

    Attributes:
        objects, recordings, sessions: names, by index.
        columns: one array (T,) per column that the source had, see `COLUMNS`.
        live: bool (H, W), sensors whose counts ever vary.
        weights: grams per object, or None.
        action: seconds (recordings, 2) from and to which each is handled, or None.
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

    def __enter__(self) -> "Recordings":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __len__(self) -> int:
        return len(self._file["pressure"])

    @property
    def dtype(self) -> np.dtype:
        return self._file["pressure"].dtype

    @property
    def shape(self) -> tuple[int, int]:
        return self.live.shape

    def frames(self, index: np.ndarray) -> np.ndarray:
        """Counts (n, H, W) of the frames of a rising index (n,), read block by block."""
        out, pressure, done = np.empty((len(index), *self.shape), self.dtype), self._file["pressure"], 0
        for start in range(0, len(self), BLOCK):
            stop = int(np.searchsorted(index, start + BLOCK))
            if stop > done:
                out[done:stop] = pressure[start : start + BLOCK][index[done:stop] - start]
                done = stop
        return out

    def blocks(self) -> Iterator[tuple[int, np.ndarray]]:
        """(number of the first frame, counts (n, H, W)) over the whole table, in order."""
        pressure = self._file["pressure"]
        for start in range(0, len(pressure), BLOCK):
            yield start, pressure[start : start + BLOCK]
