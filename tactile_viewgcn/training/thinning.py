"""A sample of frames that has many recordings, and of each enough frames to draw view sets from."""

import numpy as np

from tactile_viewgcn.randomness import by_turns, stream
from tactile_viewgcn.tables.frames import Frames

SEED = 0  # of recordings that are taken, so that these are the same for every value of `seed`


def thinned(table: Frames, index: np.ndarray, *, most: int, each: int) -> np.ndarray:
    """At most so many of the frames in `index` (n,), rising: of every recording equally many, evenly taken.

    A recording counts once for each class and split group. Where fewer than `each` frames of every recording would be
    left, these many are taken of some recordings, drawn at random, of every class as many as can be.
    """
    if len(index) <= most:
        return index
    places = np.stack([table.label[index], table.recording[index], table.group[index]])
    cells, recording, sizes = np.unique(places, axis=1, return_inverse=True, return_counts=True)
    recording = recording.ravel()
    share = max(each, most // len(sizes))
    order = by_turns(cells[0], stream(SEED, "thinned"))
    taken = np.zeros(len(sizes), dtype=bool)
    taken[order] = np.minimum(sizes, share)[order].cumsum() <= most
    rank, by_recording = np.empty(len(index), dtype=np.int64), np.argsort(recording, kind="stable")
    rank[by_recording] = np.arange(len(index)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    size = sizes[recording]
    even = rank * share // size > (rank - 1) * share // size
    return index[even & taken[recording]]
