"""Takes the training recordings out of a table of frames, as examples for the members."""

from collections.abc import Sequence

import numpy as np

from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.frame_values import every_few
from tactile_viewgcn.members.representation import (
    Representation,
    contact_unit,
    successive_noise,
)
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.frames import TRAIN, Frames

SCALE_FRAMES = 20_000  # number of frames that the scale of readings rests on


def training_recordings(table: Frames) -> list[np.ndarray]:
    """Return the indices of the frames of each training recording, in the order of time.

    A recording of several objects or split groups counts as one recording for each of them.

    Args:
        table: the frames of all sets.
    """
    train = table.on(TRAIN)
    columns = np.stack([table.label[train], table.group[train], table.recording[train]])
    _, recording, frames = np.unique(columns, axis=1, return_inverse=True, return_counts=True)
    in_recordings = train[np.argsort(recording.ravel(), kind="stable")]
    return np.split(in_recordings, np.cumsum(frames)[:-1])


def examples_of(
    table: Frames, recordings: Sequence[np.ndarray], sizes: Sequence[int], seed: int
) -> Examples:
    """Return the training recordings as examples, whole and as view sets.

    Args:
        table: the frames of all sets.
        recordings: what `training_recordings` returned.
        sizes: numbers of frames in view sets.
        seed: of every random choice.
    """

    def read(recording: int) -> np.ndarray:
        return table.inputs(every_few(recordings[recording]), "counts")[:, table.live]

    train = table.on(TRAIN)
    sample = table.inputs(evenly(train, SCALE_FRAMES), "counts")[:, table.live]
    noise = successive_noise(table.counts, table.recording, train, table.live)
    representation = Representation.of(table.live, sample, contact_unit(sample, noise))
    first_frames = [index[0] for index in recordings]
    labels = table.label[first_frames].astype(np.int64)
    return Examples(
        read, labels, representation, sizes=sizes, classes=len(table.classes), seed=seed
    )
