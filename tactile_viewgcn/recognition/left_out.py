"""Cross-validation inside the training side: parts of it that are left out, and what is answered of them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tactile_viewgcn.frames.split import fold_sides, spans_classes
from tactile_viewgcn.recognition.novelty import spread_sets
from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION, Frames
from tactile_viewgcn.training.thinning import thinned

FOLDS = 3
MOST_FRAMES, LEAST_FRAMES = 20_000, 16  # that are used, of the anchors and of the others; of a recording
MOST_SETS = 1000  # of a part that are answered
DRAWS = 10  # view sets around each anchor, at most
WHOLE = 32  # frames that stand for a whole recording


def left_out_parts(table: Frames) -> Iterator[Frames]:
    """The table with a third of the training groups on the validation side, and nothing else there, at a time.

    A class of which a fold holds all groups is left out of it. Of many frames some are used, see `training_sample`.
    """
    train = training_sample(table)
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
    """Places in `index` (n,) of the anchors, each ten times, or some of them, 1,000 at most."""
    anchors = np.repeat(np.flatnonzero(table.anchor[index]), DRAWS)
    return anchors[:: -(-len(anchors) // MOST_SETS)]


def training_sample(table: Frames) -> np.ndarray:
    """Rising indices of training frames: 20,000 anchors at most, and as many other frames of their recordings."""
    train = table.on(TRAIN)
    anchor = table.anchor[train]
    anchors = thinned(table, train[anchor], most=MOST_FRAMES, each=LEAST_FRAMES)
    others = train[~anchor & np.isin(table.recording[train], table.recording[anchors])]
    return np.sort(np.concatenate([anchors, thinned(table, others, most=MOST_FRAMES, each=LEAST_FRAMES)]))
