"""The table of raw counts of recordings in memory."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tactile_viewgcn.tables.recordings import Recordings


class ArrayRecordings(Recordings):
    """The table of raw counts of n arrays; the recordings are named X[0], X[1] and so on.

    Args:
        arrays: (T_i, H, W) each, of one type.
        objects: names.
        labels: (n,) index of each recording's object.
        sessions: (n,) number of each recording's session, from 0.
    """

    def __init__(self, arrays: Sequence[np.ndarray], objects: list[str], labels: np.ndarray, sessions: np.ndarray):
        self.path = Path("X")
        self.counts = pressure = np.concatenate(arrays)
        lengths = [len(array) for array in arrays]
        row = np.repeat(np.arange(len(arrays)), lengths)
        self.objects, self.channel_names = objects, []
        self.recordings = [f"X[{number}]" for number in range(len(arrays))]
        self.sessions = [f"session {number}" for number in range(int(sessions.max()) + 1)]
        self.columns = {
            "object": labels[row],
            "recording": row,
            "session": sessions[row],
            "frame": np.concatenate([np.arange(length) for length in lengths]),
            "time": np.full(len(row), np.nan),
        }
        self.live, self.notes = (pressure != pressure[0]).any(axis=0), []
