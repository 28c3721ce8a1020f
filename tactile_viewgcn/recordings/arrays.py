"""A source of recordings that are arrays in memory."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.recordings.source import UNLABELLED, Block, Source, check_shape, storage_type


def source_of_arrays(
    recordings: Sequence[np.ndarray], labels: Sequence[str] | None = None, sessions: Sequence[str] | None = None
) -> Source:
    """A source of recordings of raw counts (T, H, W), each with frames of its own number, named 0, 1, ...

    Args:
        labels: the object of each recording; None: unlabelled.
        sessions: the session of each recording; None: all are of one.

    Raises:
        UserError: no recordings; arrays of another or of different shapes, or not of numbers.
    """
    if not len(recordings):
        raise UserError("recordings holds none; expected one array (frames, rows, columns) or more")
    arrays = [np.asarray(counts) for counts in recordings]
    shapes = {check_shape(counts.shape, f"recording {number}") for number, counts in enumerate(arrays)}
    if len(shapes) > 1:
        raise UserError(f"recordings have frames of {' and '.join(map(str, sorted(shapes)))}; expected one shape")
    labels = [UNLABELLED] * len(arrays) if labels is None else [str(label) for label in labels]
    sessions = ["session"] * len(arrays) if sessions is None else [str(session) for session in sessions]
    objects, names = sorted(set(labels)), sorted(set(sessions))

    def blocks() -> Iterator[Block]:
        for number, (counts, label, session) in enumerate(zip(arrays, labels, sessions, strict=True)):
            ids = {"object": objects.index(label), "recording": number, "session": names.index(session)}
            columns = {name: np.full(len(counts), value) for name, value in ids.items()}
            yield columns | {
                "pressure": counts,
                "frame": np.arange(len(counts)),
                "time": np.full(len(counts), np.nan),
            }

    dtype = storage_type(np.result_type(*arrays), "recordings")
    return Source(Path("arrays"), objects, [str(i) for i in range(len(arrays))], names, shapes.pop(), dtype, blocks())
