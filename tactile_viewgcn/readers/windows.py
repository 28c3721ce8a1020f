"""Find the windows that were cut from one stream and overlap."""

import numpy as np

# fewest readings that must change between the frames that two windows share
OVERLAP_CHANGES = 3


def overlapping(windows: np.ndarray) -> np.ndarray:
    """Return for each window but the first whether it overlaps the window before it.

    A window overlaps if its first frames are the last frames of the window before. These must be at
    least two frames, in which at least `OVERLAP_CHANGES` readings change. Frames that do not change
    are no overlap: a hand at rest and padding look alike in all windows.

    Args:
        windows: (n, T, ...), the windows of T frames each.

    Returns:
        bool (n - 1,).
    """
    from pandas import DataFrame  # here, since it loads slowly
    from pandas.util import hash_pandas_object

    count, length = windows.shape[:2]
    frames = windows.reshape(count, length, -1)
    # equal frames have equal hashes
    hashes = hash_pandas_object(DataFrame(frames.reshape(count * length, -1)), index=False)
    hashes = hashes.to_numpy().reshape(count, length)
    before = hashes[:-1]
    after = hashes[1:]
    changed = np.count_nonzero(frames[1:, 1:] != frames[1:, :-1], axis=2)
    # changes up to the second frame, up to the third, and so on
    changes = np.cumsum(changed, axis=1)
    # short windows have too few steps for so many changes
    fewest_changes = max(1, min(OVERLAP_CHANGES, (length - 2) * frames.shape[2]))
    # frames of the window before that equal the first frame of the next window
    is_first = before == after[:, :1]
    # frames of the next window that equal the last frame of the window before
    is_last = after == before[:, -1:]
    overlaps = np.zeros(len(after), dtype=bool)
    for shared in range(2, length + 1):
        begins = is_first[:, length - shared]
        ends = is_last[:, shared - 1]
        moves = changes[:, shared - 2] >= fewest_changes
        rows = np.flatnonzero(begins & ends & moves & ~overlaps)
        shares_all = before[rows, length - shared :] == after[rows, :shared]
        overlaps[rows] = shares_all.all(axis=1)
    return overlaps
