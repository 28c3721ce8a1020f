"""The training recordings that systems on the sensors are fitted to: one of each object, and fewer of very many."""

from dataclasses import replace

import numpy as np

from tactile_viewgcn.sensors import features
from tactile_viewgcn.sensors.examples import WHOLE
from tactile_viewgcn.tables.frames import TRAIN
from tactile_viewgcn.training import sensor_fitting
from tactile_viewgcn.training.sensor_fitting import sensor_examples, training_recordings
from tests.glove_data import table


def test_a_recording_has_its_frames_in_order_and_one_object_and_split_group():
    frames = table()
    split = replace(frames, group=2 * frames.group + (np.arange(len(frames)) % 12 >= 6))  # two in each recording
    recordings, train = training_recordings(split), split.on(TRAIN)
    assert np.array_equal(np.sort(np.concatenate(recordings.frames)), train)
    for index, label, group in zip(*recordings, strict=True):
        assert (np.diff(index) == 1).all() and len(set(split.recording[index])) == 1 and len(index) == 6
        assert set(split.label[index]) == {label} and set(split.group[index]) == {group}


def test_of_too_many_recordings_some_of_every_class_are_taken():
    labels = np.r_[np.zeros(90, int), np.ones(9, int), 2]
    many = sensor_fitting.TrainingRecordings([np.array([each]) for each in range(100)], labels, np.arange(100) // 2)
    few = many.part(12)
    assert np.bincount(few.labels).tolist() == [6, 5, 1] and many.part(100) is many
    assert [(labels[index[0]], index[0] // 2) for index in few.frames] == [*zip(few.labels, few.groups, strict=True)]


def test_of_a_long_recording_every_second_or_further_frame_is_taken(monkeypatch):
    monkeypatch.setattr(features, "MOST_FRAMES", 5)
    taken = [features.every_few(np.arange(frames)).tolist() for frames in (1, 5, 6, 11)]
    assert taken == [[0], [*range(5)], [0, 2, 4], [0, 3, 6, 9]]
    recordings = training_recordings(frames := table())  # of twelve frames: every third is read
    examples = sensor_examples(frames, recordings, ["svm"], 4, "random", 0)
    assert examples.shortest == 4 and set(examples.sets) == {1, 2, 4}
    read, counts = examples.representation, frames.inputs(recordings.frames[3][::3], "counts")[:, frames.live]
    expected = read.points("svm", read.scaled(counts)[None], whole=True)
    np.testing.assert_allclose(examples.points("svm", WHOLE)[3:4], expected, atol=1e-6)
