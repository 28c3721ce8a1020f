"""Windows that were cut from one stream: which of them overlap."""

import numpy as np

# fewest readings that change from a frame to the next, in the frames that two windows share
OVERLAP_CHANGES = 3


def overlapping(windows: np.ndarray) -> np.ndarray:
    """Return whether each window but the first overlaps the one before.

    The last frames of the one before are its first frames, two at least, and three readings change
    in them. Frames at rest and padding are alike in all windows: equal frames that do not change
    are no overlap.

    Args:
        windows: (n, T, ...), of T frames each.

    Returns:
        bool (n - 1,).
    """
    from pandas import DataFrame  # here, since it loads slowly
    from pandas.util import hash_pandas_object

    count, length = windows.shape[:2]
    frames = windows.reshape(count, length, -1)
    # hashes of equal frames are equal
    hashes = hash_pandas_object(DataFrame(frames.reshape(count * length, -1)), index=False)
    hashes = hashes.to_numpy().reshape(count, length)
    before = hashes[:-1]
    after = hashes[1:]
    changed = np.count_nonzero(frames[1:, 1:] != frames[1:, :-1], axis=2)
    changes = np.cumsum(changed, axis=1)  # up to the second frame, the third and so on
    # of short windows all but one frame's
    fewest_changes = max(1, min(OVERLAP_CHANGES, (length - 2) * frames.shape[2]))
    is_first = before == after[:, :1]  # frames of the one before that are the first of the next
    is_last = after == before[:, -1:]  # frames of the next that are the last of the one before
    overlaps = np.zeros(len(after), dtype=bool)
    for shared in range(2, length + 1):
        begins = is_first[:, length - shared]
        ends = is_last[:, shared - 1]
        moves = changes[:, shared - 2] >= fewest_changes
        rows = np.flatnonzero(begins & ends & moves & ~overlaps)
        shares_all = before[rows, length - shared :] == after[rows, :shared]
        overlaps[rows] = shares_all.all(axis=1)
    return overlaps
