"""Cross-validation inside the training side: parts of it that are left out, and what is answered of them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tactile_viewgcn.frames.split import SPLIT_SEED, fold_sides, spans_classes
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.novelty import spread_sets
from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION, Frames

FOLDS = 3
MOST_GROUPS = 900  # that are used
MOST_FRAMES = 64  # of a recording that are used, of the anchors and of the others
MOST_SETS = 2000  # of a part that are answered
DRAWS = 10  # view sets around each anchor, at most
WHOLE = 32  # frames that stand for a whole recording


def left_out_parts(table: Frames) -> Iterator[Frames]:
    """The table with a third of the training groups on the validation side, and nothing else there, at a time.

    A class of which a fold holds all groups is left out of it. Of many groups and of long recordings some are used, see
    `_thinned`.
    """
    train = _thinned(table, table.on(TRAIN))
    group, label = table.group[train], table.label[train]
    for fold in range(FOLDS):
        left_out = fold_sides(group, label, folds=FOLDS, fold=fold, across=spans_classes(group, label)) == TEST
        left_out &= np.isin(label, label[~left_out])
        side = np.full(len(table), TEST, dtype=table.side.dtype)
        side[train] = np.where(left_out, VALIDATION, TRAIN)
        if (table.anchor & (side == VALIDATION)).any():
            yield replace(table, side=side)


def recording_sets(table: Frames, index: np.ndarray, views: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Recordings as a whole, of the frames in `index` (n,).

    Returns:
        pool (n,): recording of each frame, counted from 0, and on its own for each class and split group.
        few (P, V), most (P, k): places in `index` that stand for each of them, evenly spread. Where no recording has
            more than V frames, k is V; else 32, or V where that is more.
    """
    places = np.stack([table.label[index], table.recording[index], table.group[index]])
    pool = np.unique(places, axis=1, return_inverse=True)[1].ravel()
    members = [np.flatnonzero(pool == number) for number in range(pool.max(initial=-1) + 1)]
    most = max(views, WHOLE) if max(map(len, members)) > views else views
    few, whole = (np.stack([frames[spread_sets(len(frames), size)[0]] for frames in members]) for size in (views, most))
    return pool, few, whole


def sampled_anchors(table: Frames, index: np.ndarray) -> np.ndarray:
    """Places in `index` (n,) of the anchors, each ten times, or some of them, 2,000 at most."""
    anchors = np.repeat(np.flatnonzero(table.anchor[index]), DRAWS)
    return anchors[:: -(-len(anchors) // MOST_SETS)]


def _thinned(table: Frames, train: np.ndarray) -> np.ndarray:
    """Of the frames in `train` (n,) those of at most 900 groups, and of a recording at most 64 anchors and 64 others.

    They are evenly taken.
    """
    groups = np.unique(table.group[train])
    if len(groups) > MOST_GROUPS:
        some = stream(SPLIT_SEED, "left out").permutation(groups)[:MOST_GROUPS]
        train = train[np.isin(table.group[train], some)]
    places = np.stack([table.label[train], table.recording[train], table.group[train], table.anchor[train]])
    pool, sizes = np.unique(places, axis=1, return_inverse=True, return_counts=True)[1:]
    pool = pool.ravel()
    order = np.argsort(pool, kind="stable")
    rank = np.empty(len(train), dtype=np.int64)
    rank[order] = np.arange(len(train)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return train[rank % -(-sizes[pool] // MOST_FRAMES) == 0]
