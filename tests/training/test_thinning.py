"""Thinned frames: an equal number of each recording, or of fewer recordings where there are too many."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.training.sensor_fitting import thinned
from tests.glove_data import table


def recordings(*sizes):
    """A table of recordings of these numbers of frames, of two classes in turn, and its indices."""
    recording = np.repeat(np.arange(len(sizes)), sizes)
    return replace(table(), label=recording % 2, recording=recording, group=recording), np.arange(len(recording))


@pytest.mark.parametrize(
    ("sizes", "most", "each", "expected"),
    [
        ((3, 4), 7, 1, [0, 1, 2, 3, 4, 5, 6]),
        ((3, 6), 6, 1, [0, 1, 2, 3, 5, 7]),  # three of each: of six every second one
        ((5, 5), 4, 1, [0, 3, 5, 8]),
        ((1, 1, 8), 6, 1, [0, 1, 2, 6]),  # what short recordings leave is left
    ],
)
def test_equally_many_of_each_recording_evenly_taken(sizes, most, each, expected):
    assert thinned(*recordings(*sizes), most=most, each=each).tolist() == expected


def test_too_many_recordings_are_thinned_as_a_whole_and_all_classes_stay():
    frames, index = recordings(*[6] * 400)
    taken = thinned(frames, index, most=400, each=4)
    counts = np.bincount(frames.recording[taken], minlength=400)
    assert sorted(set(counts)) == [0, 4] and len(taken) == 400 and (np.diff(taken) > 0).all()
    assert (counts[::2] > 0).sum() == 50  # of one class


def test_a_class_of_one_recording_stays_and_the_others_take_turns():
    frames, index = recordings(*[6] * 90)
    label = np.repeat(np.arange(90), 6) // 30
    label[-6:] = 3
    taken = thinned(replace(frames, label=label), index, most=40, each=4)
    assert np.bincount(label[taken]).tolist() == [12, 12, 12, 4]
