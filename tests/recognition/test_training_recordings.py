"""The training recordings that systems on the sensors are fitted to: one of each object, and fewer of very many."""

from dataclasses import replace

import numpy as np

from tactile_viewgcn.recognition.fitting import examples_of, first_frames, thinned, training_recordings
from tactile_viewgcn.sensors import features
from tactile_viewgcn.tables.frames import TRAIN
from tests.glove_data import table


def test_a_recording_has_its_frames_in_order_and_one_object_and_split_group():
    frames = table()
    split = replace(frames, group=2 * frames.group + (np.arange(len(frames)) % 12 >= 6))  # two in each recording
    recordings, train = training_recordings(split), split.on(TRAIN)
    assert np.array_equal(np.sort(np.concatenate(recordings)), train)
    for index in recordings:
        assert (np.diff(index) == 1).all() and len(index) == 6
        assert all(len(set(column[index])) == 1 for column in (split.recording, split.label, split.group))


def test_of_too_many_recordings_some_of_every_class_are_taken():
    labels = np.r_[np.zeros(90, int), np.ones(9, int), 2]
    many = [np.array([each]) for each in range(100)]
    few = first_frames(thinned(many, labels, 12))
    assert np.bincount(labels[few]).tolist() == [6, 5, 1] and (np.diff(few) > 0).all()
    assert thinned(many, labels, 100) is many


def test_of_a_long_recording_every_second_or_further_frame_is_taken(monkeypatch):
    monkeypatch.setattr(features, "MOST_FRAMES", 5)
    taken = [features.every_few(np.arange(frames)).tolist() for frames in (1, 5, 6, 11)]
    assert taken == [[0], [*range(5)], [0, 2, 4], [0, 3, 6, 9]]
    frames = table()  # of twelve frames every third is read
    recordings = training_recordings(frames)
    examples = examples_of(frames, recordings, ["svm"], (1, 2, 4), 0)
    assert set(examples.lengths) == {4} and set(examples.sets) == {1, 2, 4}
    read, counts = examples.representation, frames.inputs(recordings[3][::3], "counts")[:, frames.live]
    expected = read.of_recordings("svm", read.scaled(counts)[None])
    np.testing.assert_allclose(examples.of_recordings("svm")[0][3:4], expected, atol=1e-6)
