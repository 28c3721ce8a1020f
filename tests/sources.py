"""Sources and tables of recordings with chosen contents, for tests of what is computed from them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tactile_viewgcn.readers.source import Source
from tactile_viewgcn.tables.recordings import Recordings, write_recordings

DEFAULTS = {"object": 0, "recording": 0, "session": 0, "time": 0.0}


def source(
    counts: np.ndarray,
    *,
    cuts: Sequence[int] = (),
    dtype: type | None = None,
    objects: Sequence[str] | None = None,
    recordings: Sequence[str] | None = None,
    sessions: Sequence[str] | None = None,
    **columns: np.ndarray | float,
) -> Source:
    """A source at the path `glove` of counts (T, H, W), in blocks that end at `cuts`.

    Columns are (T,) or one value for all frames; names that are not given are made up for the ids there are, the
    first object being the empty hand.
    """
    counts = np.asarray(counts)
    frames = len(counts)
    values = {name: np.broadcast_to(value, frames) for name, value in (DEFAULTS | columns).items()}
    values.setdefault("frame", np.arange(frames))

    def names(column: str, first: str) -> list[str]:
        return [first, *(f"{column}{i}" for i in range(1, int(values[column].max(initial=0)) + 1))]

    parts = np.split(np.arange(frames), cuts)
    return Source(
        Path("glove"),
        list(objects or names("object", "empty_hand")),
        list(recordings or names("recording", "recording0")),
        list(sessions or names("session", "session0")),
        counts.shape[1:],
        np.dtype(dtype or counts.dtype),
        frames,
        iter([{"pressure": counts[at], **{name: column[at] for name, column in values.items()}} for at in parts]),
    )


def written(path: Path, counts: np.ndarray, **changes: object) -> Recordings:
    """The same as a table written to `path` and opened."""
    write_recordings(path, source(counts, **changes), "0" * 32)
    return Recordings(path)


def read(source: Source) -> dict[str, np.ndarray]:
    """Pressure and columns of all blocks, joined."""
    blocks = list(source.blocks)
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
