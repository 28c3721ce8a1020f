"""Cross-validation on the training side: a third of its groups at a time is answered by fits to the others.

The choice of members and the calibration answer the same view sets: random frames of a recording, and whole recordings.
Each makes its own fits: the choice's are quick, and temperatures of quick fits differ, twice as high for `trees`.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tactile_viewgcn.frames.split import fold_sides, spans_classes
from tactile_viewgcn.recognition.novelty import spread_sets
from tactile_viewgcn.recognition.sequential import sequences
from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION, Frames
from tactile_viewgcn.training.sensor_fitting import thinned

FOLDS = 3
MOST_FRAMES, LEAST_FRAMES = 20_000, 16  # used of the anchors, and of the others; used of a recording
MOST_SETS = 1000  # view sets of a part that are answered
DRAWS = 10  # view sets around each anchor, at most
WHOLE = 32  # frames by which a whole recording is answered


def left_out_parts(table: Frames) -> Iterator[Frames]:
    """Three tables, each with a third of the training groups, and nothing else, on the validation side.

    A class stays on the training side where all its groups would be left out. Of many frames only some are used, see
    `training_sample`.
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


class LeftOut:
    """View sets of the validation side of a table.

    Attributes:
        index: (n,) of its frames in the table; label, group: (n,) of each.
        drawn: (A, V) indices into these: an anchor, then others of its recording at random.
        few: (P, V), whole: (P, k) indices into these, evenly spread over each of P recordings. k is V where no
            recording has more than V frames; else it is 32, or V where that is more.
    """

    def __init__(self, table: Frames, views: int, rng: np.random.Generator):
        self.index = index = table.on(VALIDATION)
        self.label, self.group = table.label[index].astype(np.int64), table.group[index]
        places = np.stack([self.label, table.recording[index], self.group])
        pool = np.unique(places, axis=1, return_inverse=True)[1].ravel()
        members = [np.flatnonzero(pool == number) for number in range(pool.max(initial=-1) + 1)]
        most = max(views, WHOLE) if max(map(len, members)) > views else views
        self.few, self.whole = (
            np.stack([frames[spread_sets(len(frames), size)[0]] for frames in members]) for size in (views, most)
        )
        anchors = np.repeat(np.flatnonzero(table.anchor[index]), DRAWS)
        self.drawn = sequences(anchors[:: -(-len(anchors) // MOST_SETS)], pool, views, rng)

    def wrong(self, sets: np.ndarray, logits: np.ndarray) -> np.ndarray:
        """Share of wrong answers (G,) in each group, by logits (A, classes) of sets (A, k); NaN without answers."""
        wrong = logits.argmax(axis=1) != self.label[sets[:, 0]]
        groups, place = np.unique(self.group, return_inverse=True)
        of_set = place[sets[:, 0]]
        count = np.bincount(of_set, minlength=len(groups))
        return np.bincount(of_set, wrong, len(groups)) / np.where(count, count, np.nan)


def training_sample(table: Frames) -> np.ndarray:
    """Rising indices of training frames: at most 20,000 anchors, and as many other frames of their recordings."""
    train = table.on(TRAIN)
    anchor = table.anchor[train]
    anchors = thinned(table, train[anchor], most=MOST_FRAMES, each=LEAST_FRAMES)
    others = train[~anchor & np.isin(table.recording[train], table.recording[anchors])]
    return np.sort(np.concatenate([anchors, thinned(table, others, most=MOST_FRAMES, each=LEAST_FRAMES)]))
