"""What every reader returns, and the checks that every source passes."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.names import EMPTY_HAND
from tactile_viewgcn.notes import several

UNLABELLED = ""  # in the place of an object's name, of recordings whose object is asked for
TRAIN, TEST = 0, 1  # codes of the published split
MAX_SIDE = 64  # rows and columns of a frame
BLOCK_FRAMES = 4096  # read or written at once
MAX_PRESSURE = 1e30  # absolute value; the network's input is in single precision
MOST_SECONDS = 1e9  # of a time, thirty years
MIN_SPREAD = 1e-30  # of the readings of some sensor, likewise
MAX_LISTED = 10  # mistakes or names in one message
MOST_NAMES = 2**15  # of one kind: ids are int16
MOST_LETTERS = 1000  # of a name
SOURCE_MD5 = "source_md5"  # attribute that only the table of recordings has: md5 of its source

#: Type of each column, one value per frame. The first five are always there, the others if the source has them.
COLUMNS = {
    "object": np.int16,  # index into objects
    "recording": np.int16,  # index into recordings
    "session": np.int16,  # index into sessions
    "frame": np.int32,  # frame number inside the recording
    "time": np.float64,  # seconds since the recording's first frame
    "split": np.int8,  # published side: TRAIN or TEST
    "valid": np.bool_,  # the object is held (STAG: hasValidLabel)
    "balanced": np.bool_,  # STAG's subset of equally many frames a class (isBalanced)
    "grasp": np.int16,  # number of the grasp inside the recording (graspIndex)
    "grasp_valid": np.bool_,  # 4th to 6th second of a grasp (graspValid)
}
Block = dict[str, np.ndarray]  # "pressure" (n, H, W) and columns (n,) of consecutive frames


@dataclass(frozen=True)
class Source:
    """Recordings as a reader describes them, and their frames in blocks.

    Attributes:
        objects, recordings, sessions: names, by index.
        shape: (H, W) of a frame.
        dtype: of the stored pressure.
        frames: number of all frames.
        blocks: the frames in the file's order; can be read once.

    Raises:
        UserError: too many names for the table, or one that is no text.
    """

    path: Path
    objects: list[str]
    recordings: list[str]
    sessions: list[str]
    shape: tuple[int, int]
    dtype: np.dtype
    frames: int
    blocks: Iterator[Block]

    def __post_init__(self) -> None:
        for kind, names in self.names.items():
            if len(names) > MOST_NAMES:
                raise UserError(f"{self.path}: {len(names):,} {kind}s; expected at most {MOST_NAMES:,}")
            if kind == "object" and len(set(names)) < len(names):
                twice = next(name for name in names if names.count(name) > 1)
                raise UserError(f"{self.path}: two objects are named {twice!r}; expected each name once")
            for name in names:
                if len(name) > MOST_LETTERS or "\0" in name or name != name.encode(errors="ignore").decode():
                    raise UserError(
                        f"{self.path}: the name of {kind} {name[:MOST_LETTERS]!r} is no text; expected UTF-8 without "
                        f"NUL, up to {MOST_LETTERS:,} letters"
                    )

    @property
    def names(self) -> dict[str, list[str]]:
        """Names by the column whose ids lead to them."""
        return {"object": self.objects, "recording": self.recordings, "session": self.sessions}


def numbered(names: list[str]) -> list[str]:
    """The distinct names in the order of the alphabet, the empty hand first: an object's id is its place."""
    return sorted(set(names), key=lambda name: (name != EMPTY_HAND, name))


def storage_type(dtype: np.dtype, where: str) -> np.dtype:
    """Type in which pressure is stored: int16 or int32 for integers, float32 or float64 for real numbers.

    Raises:
        UserError: another type; `where` begins the message.
    """
    if dtype.kind in "iu":
        return np.dtype(np.int16 if dtype.itemsize < 2 or dtype == np.int16 else np.int32)
    if dtype.kind == "f":
        return np.dtype(np.float32 if dtype.itemsize <= 4 else np.float64)
    raise UserError(f"{where}: pressure is of type {dtype}; expected integer counts or real numbers")


def check_shape(shape: tuple[int, ...], where: str) -> tuple[int, int]:
    """(H, W) of pressure (T, H, W); a UserError that begins with `where` for other axes, or above `MAX_SIDE`."""
    if len(shape) != 3:
        raise UserError(f"{where}: pressure has shape {shape}; expected (frames, rows, columns)")
    if not all(1 <= side <= MAX_SIDE for side in shape[1:]):
        raise UserError(f"{where}: frames of {shape[1]} x {shape[2]}; expected 1 x 1 to {MAX_SIDE} x {MAX_SIDE}")
    return shape[1], shape[2]


def listed(names: list[str]) -> str:
    """The first ten names, and how many more there are."""
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    return ", ".join(names[:MAX_LISTED]) + more


def raise_mistakes(mistakes: list[str]) -> None:
    """Raise a UserError that lists the first ten mistakes, if there are any, and counts the others."""
    if mistakes:
        more = [f"and {len(mistakes) - MAX_LISTED} more"] if len(mistakes) > MAX_LISTED else []
        raise UserError("; ".join(mistakes[:MAX_LISTED] + more))


def checked_blocks(source: Source) -> Iterator[Block]:
    """The blocks of a source that hold frames, each checked; none after the first mistake.

    Raises:
        UserError: at the end, with the mistakes of all blocks: no frames or not as many as `source.frames`, a damaged
            file, an id out of range, or pressure that cannot be stored.
    """
    total, mistakes = 0, []
    try:
        for block in source.blocks:
            if len(block["pressure"]):
                mistakes += _mistakes_of_block(block, source, total)
                total += len(block["pressure"])
                if not mistakes:
                    yield block
        if not total:
            mistakes.append(f"{source.path}: no frames; expected at least one recording with frames in it")
        elif total != source.frames:
            mistakes.append(
                f"{source.path}: {total} of {several(source.frames, 'frame')}; expected all, download it again"
            )
    except UserError as error:  # of the reader
        mistakes.append(str(error))
    raise_mistakes(mistakes)


def _mistakes_of_block(block: Block, source: Source, start: int) -> list[str]:
    """Ids, columns and pressure out of range; `start` is the number of the first frame."""
    counts, path, mistakes = block["pressure"], source.path, []
    if source.dtype.kind == "i" and not np.can_cast(counts.dtype, source.dtype):
        limits = np.iinfo(source.dtype)
        if counts.min() < limits.min or counts.max() > limits.max:
            mistakes.append(
                f"{path}: pressure from {counts.min()} to {counts.max()}; "
                f"expected counts from {limits.min} to {limits.max}"
            )
    names = source.names
    for column, kind in COLUMNS.items():
        if column not in block:
            continue
        low: float = 0
        high: float = 1
        remark = "in whole numbers"
        if kind is np.float64:
            low, high, remark = -MOST_SECONDS, MOST_SECONDS, "seconds"
        if column in names:
            high, remark = len(names[column]) - 1, f"({len(names[column])} {column}s)"
        elif kind is not np.bool_ and kind is not np.float64:
            low, high = np.iinfo(kind).min, np.iinfo(kind).max
        values = block[column]
        if kind is np.float64:
            inside = np.isnan(values) | (np.abs(values) <= high)  # NaN: not known
        else:
            inside = (values >= low) & (values <= high) & (values == np.floor(values))
        if not inside.all():
            at, what = int(inside.argmin()), f"{column} id" if column in names else column
            mistakes.append(
                f"{path}: {what} {values[at]} of frame {start + at} is out of range; expected {low:.10g} to "
                f"{high:.10g} {remark}"
            )
    wide = counts.astype(np.float32) if counts.dtype == np.float16 else counts  # in which the limit is infinite
    if not mistakes and counts.dtype.kind == "f" and not (inside := np.abs(wide) <= MAX_PRESSURE).all():
        bad = int(inside.all(axis=(1, 2)).argmin())
        value, recording = counts[bad][~inside[bad]][0], source.recordings[int(block["recording"][bad])]
        remedy = ": rescale the readings" if np.isfinite(value) else ""
        mistakes.append(
            f"{path}: pressure of frame {block['frame'][bad]} of recording {recording} is {value:g}; expected a number "
            f"from every sensor, up to {MAX_PRESSURE:g}{remedy}"
        )
    return mistakes
