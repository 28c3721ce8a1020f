"""Systems on the sensors are fitted to training recordings, each of one object."""

from dataclasses import replace

import numpy as np

from tactile_viewgcn.members import frame_values
from tactile_viewgcn.members.svm import SvmMember
from tactile_viewgcn.recognition.training_recordings import examples_of, training_recordings
from tactile_viewgcn.tables.frames import TRAIN
from tests.glove_data import table


def test_a_recording_has_its_frames_in_order_and_one_object_and_split_group():
    frames = table()
    # two in each recording
    split = frames.with_columns(group=2 * frames.group + (np.arange(len(frames)) % 12 >= 6))
    recordings = training_recordings(split)
    train = split.on(TRAIN)
    assert np.array_equal(np.sort(np.concatenate(recordings)), train)
    for index in recordings:
        assert (np.diff(index) == 1).all()
        assert len(index) == 6
        for column in (split.recording, split.label, split.group):
            assert len(set(column[index])) == 1


def test_the_unit_of_an_array_is_limited_by_its_noise():
    """A quarter of the sensors read 200 counts more, and the noise is about one count."""
    frames = table()
    pressed = 200 * (np.arange(12)[:, None] // 3 == frames.label[:, None, None])
    dense = replace(frames, counts=(frames.counts + pressed).astype(np.int16))
    unit = examples_of(dense, training_recordings(dense), (4,), 0).representation.spread[0]
    assert 1 < unit < 10


def test_of_a_long_recording_every_second_or_further_frame_is_taken(monkeypatch):
    monkeypatch.setattr(frame_values, "MOST_FRAMES", 5)
    taken = [frame_values.every_few(np.arange(frames)).tolist() for frames in (1, 5, 6, 11)]
    assert taken == [[0], [*range(5)], [0, 2, 4], [0, 3, 6, 9]]
    frames = table()  # of twelve frames every third is read
    recordings = training_recordings(frames)
    examples = examples_of(frames, recordings, (1, 2, 4), 0)
    assert set(examples.lengths) == {4}
    assert set(examples.sets) == {1, 2, 4}
    counts = frames.inputs(recordings[3][::3], "counts")[:, frames.live]
    member = SvmMember(examples.representation, examples.classes)
    expected = member.recording_points(examples.representation.scaled(counts)[None])
    points = examples.recording_points("svm", member.recording_points)
    np.testing.assert_allclose(points[3:4], expected, atol=1e-6)
